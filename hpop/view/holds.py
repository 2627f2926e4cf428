"""Holds in a picture: a small clock beside each place where a robot stands still, and for how long."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.path import Path
from matplotlib.transforms import offset_copy

from hpop.base.arrays import BoolArray
from hpop.motions import HOLD
from hpop.trajectories.trajectory import Trajectory
from hpop.view.style import HALO, QUIET, SMALL, mapped_points

SPOT = 6  # digits, m, to which the places of holds agree that are on one spot
BESIDE = 11.0  # points to the right and above the spot: on it are dots of turns, and the letters of start and goal
ROW = 13.0  # points between the clocks of two trajectories
ASIDE = 44.0  # points between two clocks of one trajectory whose spots are near each other: a clock and its time
NEAR = (0.12, 0.04)  # of the width of what is shown: spots nearer than that, along x and along y
Colour = tuple[float, float, float, float]
WHITE: Colour = (1.0, 1.0, 1.0, 1.0)
DARK = 1.5  # sum of red, green and blue
HANDS = Path([(0.0, 0.6), (0.0, 0.0), (0.45, 0.0)])
CLOCK = Path.make_compound_path(Path.unit_circle(), HANDS)


class Held(NamedTuple):
    """Where a robot stands still, m, for how long in all, s, and in which motions."""

    x: float
    y: float
    seconds: float
    motions: tuple[int, ...]


def is_held(trajectory: Trajectory) -> BoolArray:
    """Which motions (n,) are holds."""
    return np.array([kind == HOLD.kind for kind in trajectory.kinds], dtype=bool)


def holds_of(trajectory: Trajectory) -> list[Held]:
    """The places where it holds, in order of time, those on one spot together."""
    spots: dict[tuple[float, float], list[int]] = {}
    points = np.round(mapped_points(trajectory.model, trajectory.states), SPOT)
    for i in np.flatnonzero(is_held(trajectory)).tolist():
        spots.setdefault((float(points[i, 0]), float(points[i, 1])), []).append(i)
    return [Held(*spot, float(trajectory.durations[own].sum()), tuple(own)) for spot, own in spots.items()]


def written_time(seconds: float) -> str:
    """How long, in words.

    >>> written_time(3.0), written_time(2.25), written_time(0.04), written_time(600.0)
    ('3 s', '2.2 s', '0.04 s', '10 min')
    """
    if seconds >= 120.0:
        return f"{seconds / 60.0:.3g} min"
    return f"{round(seconds, 1) or seconds:.3g} s"


def draw_holds(
    axes: Axes,
    trajectory: Trajectory,
    colour: str,
    width: float,
    *,
    row: int = 0,
    gid: str = "hold",
    face: Callable[[Held], Colour] = lambda held: WHITE,
) -> None:
    """Draw the clocks of a trajectory in its colour, in a row of their own above their spots; ``face`` fills them.

    ``width`` is that of what is shown, m: clocks whose spots are near each other stand side by side.
    """
    figure = axes.get_figure(root=True)
    up = BESIDE + ROW * row
    drawn = holds_of(trajectory)
    for number, held in enumerate(drawn):
        right = BESIDE + ASIDE * sum(_are_near(held, other, width) for other in drawn[:number])
        beside = offset_copy(axes.transData, figure, right, up, units="points")
        lead: dict[str, Any] = {"arrowstyle": "-", "color": colour, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 3}
        axes.annotate("", (held.x, held.y), xytext=(right, up), textcoords="offset points", arrowprops=lead, zorder=8.5)
        axes.add_line(hold_clock(colour, held.x, held.y, face(held), transform=beside, zorder=9, gid=gid))
        axes.annotate(
            written_time(held.seconds), (held.x, held.y), xytext=(right + 8, up), textcoords="offset points",
            fontsize=SMALL, color=colour, va="center", zorder=9, path_effects=HALO, gid=gid,
        )  # fmt: skip


def _are_near(one: Held, other: Held, width: float) -> bool:
    """Whether two spots are so near that their clocks would lie on each other, in a picture so many metres wide."""
    along, across = NEAR
    return abs(one.x - other.x) < along * width and abs(one.y - other.y) < across * width


def hold_clock(
    colour: str, x: float | None = None, y: float | None = None, face: Colour = WHITE, **more: Any
) -> Line2D:
    """A clock, its hands white on a dark face; without a place the legend entry for it."""
    xs, ys = ([], []) if x is None or y is None else ([x], [y])
    edge = colour if sum(face[:3]) > DARK else "white"
    look: dict[str, Any] = {"markerfacecolor": face, "markeredgecolor": edge, "markeredgewidth": 1.2}
    return Line2D(xs, ys, linestyle="none", marker=CLOCK, markersize=10, **look, **more)


def hold_entry() -> Line2D:
    """What a legend says of clocks."""
    return hold_clock(QUIET, label="stands still, for so long")
