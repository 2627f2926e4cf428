"""Shared style of all pictures: colours, labels with units, named trajectories, and points along trajectories.

Colours of named trajectories are those of Okabe and Ito (2008, "Color universal design"), which remain distinct for
colour-blind readers; line styles and markers repeat the distinction for print without colour.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import wraps
from itertools import cycle
from textwrap import fill
from typing import NamedTuple, ParamSpec

import numpy as np
from matplotlib import rc_context
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator, ScalarFormatter

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.text import printable, shown
from hpop.criteria.base import quantity_of
from hpop.criteria.comfort.rotation import LEAST_TURN
from hpop.errors import OptionError
from hpop.frontier.choices import Preferring
from hpop.motions import Law, Model, Pose, States, laws_of
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory

COLOURS = ("#000000", "#D55E00", "#0072B2", "#CC79A7", "#009E73", "#E69F00", "#56B4E9")
DASHES: tuple[tuple[float, tuple[float, ...]], ...] = (
    (0, ()),
    (0, (5, 2.5)),
    (0, (1.2, 1.6)),
    (0, (6, 2, 1.2, 2)),
    (0, (2.5, 2.5)),
    (0, (8, 4)),
    (0, (6, 2, 1.2, 2, 1.2, 2)),
)
MARKERS = ("D", "s", "o", "^", "v", "P", "X")
POINT = "#6d7f8f"
QUIET = "#555555"
START, GOAL = "#FFFFFF", "#F0E442"
HALO = (withStroke(linewidth=2.5, foreground="white"),)
SMALL, NORMAL, LARGE = 8.5, 9.5, 11.5  # points
MOST_WIDE, MOST_HIGH = 6.4, 6.2  # inches of a map
MOST_LINES = 2_000  # more lines would not be distinguishable
P = ParamSpec("P")
NAME_WIDTH = 15  # characters a line of a stacked name


def plain(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Decorate a drawing function so that dollar signs in texts are shown literally, not parsed as formulas."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with rc_context({"text.parse_math": False}):
            return draw(*args, **kwargs)

    return drawn


@dataclass(frozen=True)
class Mark:
    """Named trajectory of a front, with the colour, dashes and marker that all pictures use for it.

    names   such as "knee", "least turns"
    row     row of the front
    colour  of its line and marker
    dashes  offset and on-off pattern, points
    marker  of its point
    """

    names: tuple[str, ...]
    row: int
    colour: str
    dashes: tuple[float, tuple[float, ...]]
    marker: str

    @property
    def label(self) -> str:
        """Return the names as one text, such as "knee, least turns"."""
        return ", ".join(self.names)

    def legend(self, columns: Iterable[Quantity], width: int) -> str:
        """Return names and costs for a legend, in lines of at most ``width`` characters, broken only between them."""
        values = ", ".join(_nonbreaking(column.text(column.values[self.row])) for column in columns)
        return fill(", ".join(map(_nonbreaking, self.names)) + ": " + values, width, break_long_words=False)


@dataclass(frozen=True, eq=False)
class Quantity:
    """Column of a front, as an axis of a picture shows it.

    values  (n,)  in the unit
    counts  whether the values are whole numbers by nature
    what    what the column measures, such as "shortfall", if its name does not say it
    """

    name: str
    unit: str
    values: FloatArray
    counts: bool
    what: str = ""

    @property
    def label(self) -> str:
        """Return the name with its unit, such as "length (m)" or "turns (count)"."""
        return label(self.name, self.unit, self.counts, self.what)

    def text(self, value: float) -> str:
        """Return the name with a value, such as "length 12.3 m" or "turns 4"."""
        name = f"{self.name} {self.what}" if self.what else self.name
        return f"{name} {value_text(value, self.unit, self.counts)}"


def label(name: str, unit: str, counts: bool, what: str = "") -> str:
    """Return the axis label of a quantity.

    counts  whether its values are whole numbers by nature
    what    what it measures, if its name does not say it

    >>> label("clearance", "m", False, "shortfall"), label("openness", "1", False, "unseen share")
    ('clearance (shortfall, m)', 'openness (unseen share)')
    >>> label("length", "m", False), label("turns", "1", True), label("obstruction", "1", False)
    ('length (m)', 'turns (count)', 'obstruction (share)')
    """
    measured = ("count" if counts else "share") if unit == "1" else unit
    if what:
        measured = what if unit == "1" else f"{what}, {unit}"
    return printable(f"{name} ({measured})")


def stacked(words: str) -> str:
    r"""Break an axis label: its unit goes on a separate line, and a long name is broken after underscores.

    >>> stacked("length (m)"), stacked("landmark_blindness (s)")
    ('length\n(m)', 'landmark_\nblindness\n(s)')
    """
    name, _, unit = words.rpartition(" (")
    return fill(name.replace("_", "_ "), NAME_WIDTH, break_long_words=False).replace("_ ", "_") + f"\n({unit}"


def value_text(value: float, unit: str, counts: bool) -> str:
    """Format a value with its unit, to three digits; to whole numbers if it ``counts`` something or is large.

    >>> value_text(16.0, "m", False), value_text(4.0, "1", True), value_text(1234.5, "s", False)
    ('16.0 m', '4', '1234 s')
    """
    number = f"{value:.0f}" if counts or value == 0.0 or abs(value) >= 999.5 else f"{value:#.3g}".rstrip(".")
    return number if unit == "1" else f"{number} {unit}"


def drawn_rows(front: Front) -> IntArray:
    """Return the rows (m,) to draw as lines: all, or for a large front 2,000 evenly over its order.

    Plots of points show all rows; marked rows are always drawn.
    """
    if len(front) <= MOST_LINES:
        return np.arange(len(front))
    return np.linspace(0, len(front) - 1, MOST_LINES).round().astype(np.int64)


def how_many_drawn(front: Front) -> str:
    """Return an addition to a title if only some lines are drawn: ", 2,000 of them drawn"; otherwise ""."""
    return f", {MOST_LINES:,} of them drawn" if len(front) > MOST_LINES else ""


def quantities(front: Front) -> tuple[Quantity, ...]:
    """Return the columns of a front: its criteria, then its reported values. A cost below half its quantum is 0."""
    costs = np.where(np.abs(front.costs) < 0.5 * np.array(front.quanta), 0.0, front.costs)
    whole = [unit == "1" and quantum == 1.0 for unit, quantum in zip(front.units, front.quanta, strict=True)]
    return tuple(
        Quantity(printable(name), printable(unit), values, counts, quantity_of(name, [group]))
        for name, unit, values, counts, group in zip(
            front.names + front.reported_names,
            front.units + front.reported_units,
            np.hstack([costs, front.reported]).T,
            whole + [False] * len(front.reported_names),
            [*front.groups, *["".join(front.groups)] * len(front.reported_names)],
            strict=True,
        )
    )


def marks(
    front: Front, chosen: Mapping[str, int] | None = None, *, preference: Preferring | None = None
) -> tuple[Mark, ...]:
    """Return named trajectories: the rows ``chosen`` by label, or the knee, the least of each cost, and the preferred.

    The preferred trajectory is the best one for a person, according to ``preference``; without it there is none. A row
    with several names is one mark. Raises OptionError for a row that the front does not have.
    """
    if chosen is None:
        chosen = {name: point.index for name, point in front.named(preference).items()}
    names: dict[int, list[str]] = {}
    for name, row in chosen.items():
        if not 0 <= row < len(front):
            raise OptionError(f"chosen[{name!r}] must be a row of the front, 0 to {len(front) - 1}; got {shown(row)}")
        names.setdefault(int(row), []).append(printable(name))
    looks = zip(cycle(COLOURS), cycle(DASHES), cycle(MARKERS), strict=False)
    return tuple(Mark(tuple(names[row]), row, *look) for row, look in zip(names, looks, strict=False))


def turns_in_place(trajectory: Trajectory) -> BoolArray:
    """Return a mask (n,) of the motions that turn the robot by more than a degree without moving it."""
    pose = mapped_pose(trajectory.model, trajectory.states)
    still = np.hypot(np.diff(pose.x), np.diff(pose.y)) == 0.0
    turns: BoolArray = (np.abs(np.diff(pose.yaw)) > LEAST_TURN) & still
    return turns


def mapped_body(model: Model) -> str:
    """Return the body whose path maps show: "base", or "camera" for a robot without a base."""
    return "base" if "base" in model.provides else "camera"


def mapped_pose(model: Model, states: States) -> Pose:
    """Return the pose, in some states, of the body whose path maps show."""
    return model.pose(mapped_body(model), states)


def mapped_points(model: Model, states: States) -> FloatArray:
    """Return the positions (M, 2), m, in M states, of the body whose path maps show."""
    pose = mapped_pose(model, states)
    return np.stack([pose.x, pose.y], axis=1)


def whole_ticks(axis: Axis, counts: bool, most: int = 5) -> None:
    """Set ticks with at most ``most`` intervals between them, each labelled with its full value, such as 2e-05.

    With ``counts``, ticks are on whole numbers only.
    """
    axis.set_major_locator(MaxNLocator(nbins=most, integer=counts, min_n_ticks=1, steps=[1, 2, 5, 10]))
    axis.set_major_formatter(_WholeValue(useOffset=False))


class _WholeValue(ScalarFormatter):
    """Formatter of ticks that writes every number in full; very small and large ones carry their power of ten.

    Offsets and powers at the end of an axis are easily overlooked, and overlap other texts.
    """

    def __call__(self, x: float, pos: int | None = None) -> str:
        return f"{x:.12g}" if super().get_offset() else super().__call__(x, pos)

    def get_offset(self) -> str:
        return ""


def _nonbreaking(text: str) -> str:
    return text.replace(" ", "\N{NO-BREAK SPACE}")


CURVE_PIECES = 12  # straight pieces for a curved motion
SWING_PIECES = 24  # straight pieces for a motion of a camera, which an arm may swing by half a circle
LEVEL = 1e-3  # m: smaller differences of camera heights do not count
IN_PLANE = frozenset({"x", "y"})


class Heights(NamedTuple):
    """Range of camera heights, m."""

    low: float
    high: float

    @property
    def vary(self) -> bool:
        """Return whether the range has more than one height."""
        return self.high - self.low > LEVEL

    def __str__(self) -> str:
        return f"{round(self.low, 2):g} to {round(self.high, 2):g} m" if self.vary else f"{self.low:.3g} m"


def path_points(trajectory: Trajectory) -> FloatArray:
    """Return points (N, 2), m, of a trajectory's line on a map: ends of motions, and more along curves."""
    model = trajectory.model
    pieces = _base_pieces if "base" in model.provides else _camera_pieces
    return mapped_points(model, _sampled_states(trajectory, pieces))


def camera_path(trajectory: Trajectory) -> FloatArray:
    """Return points (N, 3), m, of the camera's path: ends of motions, and more along curves."""
    return positions(trajectory.model.pose("camera", _sampled_states(trajectory, _camera_pieces)))


def positions(pose: Pose) -> FloatArray:
    """Return the positions (N, 3), m, of N poses."""
    return np.stack(np.broadcast_arrays(pose.x, pose.y, pose.z), axis=1)


def camera_heights(problem: Problem, trajectories: Iterable[Trajectory]) -> Heights:
    """Return the range of camera heights at the start and along some trajectories."""
    model = problem.model
    start = float(model.pose("camera", model.space.state(problem.start)).z[0])
    if not may_rise(model, model.space.state(problem.start)):
        return Heights(start, start)
    z = np.concatenate([[start], *(camera_path(trajectory)[:, 2] for trajectory in trajectories)])
    return Heights(float(z.min()), float(z.max()))


def may_rise(model: Model, state: States) -> bool:
    """Return whether the model's camera can change its height.

    A twist (velocity of a body) has the number 0.0 instead of an array for a component that is always zero.
    """
    rates = States(**{name: np.ones(1) for name in state.names})
    return not isinstance(model.twist("camera", state, rates).velocity[2], float)


def _sampled_states(trajectory: Trajectory, pieces_of: Callable[[Law], int]) -> States:
    """Return the states at the ends of a trajectory's motions, and at even times within those drawn in several pieces.

    ``pieces_of`` gives the number of straight pieces in which a motion with a law is drawn.
    """
    pieces = _pieces(trajectory, pieces_of)
    if not (pieces > 1).any():
        return trajectory.states
    owner = np.repeat(np.arange(len(trajectory)), pieces)
    share = np.concatenate([np.arange(count) / count for count in pieces])
    times = trajectory.times[owner] + share * trajectory.durations[owner]
    return trajectory.at(np.append(times, trajectory.duration))


def _pieces(trajectory: Trajectory, pieces_of: Callable[[Law], int]) -> IntArray:
    """Return the number (n,) of straight pieces in which each motion is drawn."""
    laws = laws_of(trajectory.model)
    return np.array([pieces_of(laws[kind]) for kind in trajectory.kinds], dtype=np.int64)


def _base_pieces(law: Law) -> int:
    """Return the number of straight pieces for drawing a motion of the base."""
    return CURVE_PIECES if {"x", "yaw"} <= law.varies else 1


def _camera_pieces(law: Law) -> int:
    """Return the number of straight pieces for drawing a motion of the camera."""
    return 1 if law.varies <= IN_PLANE else SWING_PIECES
