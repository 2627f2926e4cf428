"""Chart of what a passenger feels along the way: the robot's speed, and the accelerations of the seat in g."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.errors import OptionError
from hpop.problems.front import Front
from hpop.trajectories.trajectory import Trajectory
from hpop.view.page import figure_for, whole
from hpop.view.style import LARGE, NORMAL, QUIET, SMALL, marks, plain, whole_ticks

G = 9.80665  # m/s², standard gravity
SAMPLES = 3000  # of each trajectory, beside the ends of its motions
WIDTH, HEIGHT, LEGEND_LINE = 7.2, 5.2, 0.2  # inches
LEGEND_COLUMNS = 2


class FeltRide(NamedTuple):
    """Ride of a passenger, at N times.

    way    (N,)  m    distance that the base has driven
    speed  (N,)  m/s  of the base
    ahead  (N,)  g    acceleration of the seat to its front
    left   (N,)  g    and to its left
    """

    way: FloatArray
    speed: FloatArray
    ahead: FloatArray
    left: FloatArray

    @classmethod
    def of(cls, trajectory: Trajectory) -> FeltRide:
        """Return the ride along a trajectory whose robot has a seat, as executed."""
        run = trajectory.execution()
        ends, near = run.times, 1e-6 * max(run.duration, 1.0)  # accelerations jump at the ends of motions
        even = np.linspace(0.0, run.duration, SAMPLES)
        times = np.unique(np.clip(np.concatenate([even, ends - near, ends + near]), 0.0, run.duration))
        states, (rates, changes) = run.at(times), run.rates(times)
        base = run.model.twist("base", states, rates).velocity
        felt, pose = run.model.twist_rate("seat", states, rates, changes).velocity, run.model.pose("seat", states)
        ahead, left = (sum(a * d for a, d in zip(felt, axis, strict=True)) / G for axis in (pose.ahead, pose.left))
        speed, ahead, left = (np.broadcast_to(each, times.shape) for each in (np.hypot(*base[:2]), ahead, left))
        way = np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(times)))
        return cls(way, speed, ahead, left)


@checked_arguments
@plain
def draw_felt(front: Front, *, chosen: Mapping[str, int] | None = None, ax: Axes | None = None) -> Figure:
    """Draw the speed, and the accelerations of the seat in g, along the way that the robot drives, as executed.

    Parameters
    ----------
    front : Front
        Its robot has a ``seat``.
    chosen : mapping from label to row, optional
        Trajectories to draw; by default the knee and the best of each criterion.
    ax : Axes, optional
        Axes in a grid, such as those of `plt.subplots`. They are removed, the picture takes their place, and this part
        of the figure is returned. Make the grid with ``layout="constrained"``, so that texts have room. By default, the
        picture is a new figure.

    Raises
    ------
    OptionError
        If the robot has no seat.
    """
    named = marks(front, chosen)
    if not all("seat" in front.trajectories[mark.row].model.provides for mark in named):
        raise OptionError(
            "this robot has no seat for a passenger; give its model the option seat: [ahead, left, height]"
        )
    figure = figure_for(ax, WIDTH, HEIGHT + LEGEND_LINE * -(-len(named) // LEGEND_COLUMNS))
    panels = figure.subplots(3, 1, sharex=True)
    farthest = 0.0
    for layer, mark in enumerate(named):
        ride = FeltRide.of(front.trajectories[mark.row])
        farthest = max(farthest, float(ride.way[-1]))
        look = {"color": mark.colour, "linestyle": mark.dashes, "linewidth": 1.6, "zorder": 3 + 0.1 * layer}
        for axes, column in zip(panels, ride[1:], strict=True):
            axes.plot(ride.way, column, **look)
    texts = ("speed (m/s)", "acceleration of the seat to the front (g)", "acceleration of the seat to the left (g)")
    for axes, text in zip(panels, texts, strict=True):
        axes.axhline(0.0, color=QUIET, linewidth=0.6, zorder=1)
        axes.set_title(text, fontsize=NORMAL, loc="left", pad=3)
        axes.tick_params(labelsize=SMALL)
        axes.margins(y=0.08)
        axes.spines[["top", "right"]].set_visible(False)
        whole_ticks(axes.yaxis, False, most=5)
    panels[0].set_xlim(0.0, farthest or 1.0)
    panels[-1].set_xlabel("way that the robot has driven (m)", fontsize=NORMAL)
    figure.suptitle("What the passenger feels along the way, as executed", fontsize=LARGE)
    handles = [Line2D([], [], label=m.label, color=m.colour, linestyle=m.dashes, linewidth=1.8) for m in named]
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=LEGEND_COLUMNS,
        fontsize=SMALL,
        frameon=False,
        handlelength=4.0,
    )
    return whole(figure)
