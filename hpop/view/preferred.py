"""What a person prefers: how much each cost counts for them, and the best trajectory on the map."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hpop.base.arguments import checked_arguments
from hpop.preference import Preference
from hpop.problems.front import FOR_YOU, Front
from hpop.problems.problem import Problem
from hpop.view.canvas import figure_for, whole
from hpop.view.map import draw_map
from hpop.view.style import COLOURS, QUIET, SMALL, plain

LEVEL = 0.9
WIDTH, HEIGHT = 13.0, 5.2


@checked_arguments
@plain
def draw_preference(problem: Problem, front: Front, person: Preference, *, ax: Axes | None = None) -> Figure:
    """Draw the share of each cost with its 90 % interval, and the map with the best trajectory and the knee.

    Parameters
    ----------
    problem : Problem
        World, model, start and goal.
    front : Front
        Its trajectories; at least one.
    person : Preference
        What was learnt, of this front or another one with the same costs.
    ax : Axes, optional
        One of a grid, whose place the picture takes; by default a new figure.

    Raises StudyError where the front lacks a cost that the preference weighs.
    """
    best = person.best(front)
    figure = figure_for(ax, WIDTH, HEIGHT)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 2.4))
    _draw_shares(left, person)
    seen = "" if person.can_be_seen else "\nno preference can be seen"
    left.set_title(f"What counts ({person.question}, {len(person.answers)} answers){seen}", fontsize=SMALL + 1)
    chosen = {"knee": front.knee().index, FOR_YOU: best.row}
    draw_map(problem, front, chosen=chosen, ax=right)
    sure = f"best with probability {best.probability[best.row]:.2f}, expected regret {100 * best.regret:.1f} %"
    right.set_title(f"{FOR_YOU}: row {best.row}, {sure}", fontsize=SMALL + 1, pad=18)
    return whole(figure)


def _draw_shares(axes: Axes, person: Preference) -> None:
    """Means as dots on intervals, a line a cost, the greatest above."""
    shares, intervals = person.weights, person.interval(LEVEL)
    names = sorted(shares, key=lambda name: shares[name])
    places = np.arange(len(names))
    low, high = np.array([intervals[name] for name in names]).T
    axes.hlines(places, low, high, color=COLOURS[2], linewidth=3, alpha=0.6)
    axes.plot([shares[name] for name in names], places, "o", color=COLOURS[2])
    axes.axvline(1 / len(names), color=QUIET, linewidth=0.8, linestyle=":")
    axes.set_yticks(places, names)
    axes.set_ylim(-0.7, len(names) - 0.3)
    axes.set_xlim(0.0, 1.0)
    axes.set_xlabel("share of the cost, with its 90 % interval;\ndotted: if all counted alike", fontsize=SMALL)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
