"""Start and goal in a picture: a letter in a circle at each; a goal at the start is a ring round it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from hpop.base.arrays import FloatArray
from hpop.motions import States
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory
from hpop.view.paths import positions
from hpop.view.style import GOAL, START, mapped

CIRCLE = 12.0  # points across
RING = 19.0  # points across
LOOKS = {"start": ("S", START), "goal": ("G", GOAL)}
SPOT = 6  # digits, m: ends that agree to so many are one
Place = Sequence[float]


class EndPose(NamedTuple):
    """Where a robot is at an end: m, m, rad; None where its yaw is free, or it has no base that looks anywhere."""

    x: float
    y: float
    yaw: float | None


Ends = tuple[EndPose, tuple[EndPose, ...]]


def end_poses(problem: Problem, found: Sequence[Trajectory] = ()) -> Ends:
    """Where a problem starts on a map, and all places where it may end.

    A goal that does not list them is where the trajectories end that were ``found``.
    """
    model, poses = problem.model, []
    for state in _end_states(problem, found):
        pose = mapped(model, state)
        x, y, yaw = (float(column[0]) for column in (pose.x, pose.y, pose.yaw))
        if not math.isnan(x + y):
            poses.append(EndPose(x, y, None if math.isnan(yaw) or "base" not in model.provides else yaw))
    return poses[0], tuple(dict.fromkeys(poses[1:]))


def end_positions(problem: Problem, found: Sequence[Trajectory] = ()) -> tuple[FloatArray, FloatArray]:
    """Where the camera starts (3,) and may end (n, 3), m: see :func:`end_poses`."""
    poses = [positions(problem.model.pose("camera", state)) for state in _end_states(problem, found)]
    places = np.concatenate(poses)
    known = places[1:][~np.isnan(places[1:]).any(axis=1)]
    return places[0], np.unique(known.round(SPOT), axis=0)


def camera_ends(problem: Problem, found: Sequence[Trajectory] = ()) -> Ends:
    """Where the camera starts, seen from above, and all places where it may end: see :func:`end_poses`.

    A heading that the goal leaves free is none. Where that lets the camera be in many places it ends where the
    trajectories do that were ``found``, or nowhere.
    """
    states, poses = _end_states(problem, found), []
    start, *listed = (problem.model.pose("camera", state) for state in states)
    if any(np.isnan(pose.x).any() for pose in listed):
        listed = [problem.model.pose("camera", trajectory.states.take([-1])) for trajectory in found]
    for pose in (start, *listed):
        x, y, yaw = (float(np.broadcast_to(column, (1,))[0]) for column in (pose.x, pose.y, pose.yaw))
        poses.append(EndPose(x, y, None if math.isnan(yaw) else yaw))
    spots = {(round(pose.x, SPOT), round(pose.y, SPOT), pose.yaw and round(pose.yaw, SPOT)): pose for pose in poses[1:]}
    return poses[0], tuple(spots.values())


def goal_words(problem: Problem, count: int) -> str:
    """What a legend says of so many goals that are drawn."""
    if not problem.target.listed:
        return ", where trajectories end"
    return f", any of {count}" * (count > 1)


def _end_states(problem: Problem, found: Sequence[Trajectory]) -> list[States]:
    """The start, then the goals; what is free in them is NaN."""
    space = problem.model.space
    states = [space.state(problem.start)]
    if problem.target.listed:
        return states + [space.state(values, free=space.angles) for values in problem.goals]
    return states + [trajectory.states.take([-1]) for trajectory in found]


def draw_ends(axes: Axes, start: Place, goals: Sequence[Place], words: tuple[str, str] = ("", "")) -> list[Line2D]:
    """Draw a letter at each; returns the legend entries, which may say more."""
    handles = []
    for (name, (letter, fill)), places, more in zip(LOOKS.items(), ([start], goals), words, strict=True):
        look: dict[str, Any] = {"marker": "o", "markerfacecolor": fill, "markeredgecolor": "black"}
        for x, y in places:
            ring = name == "goal" and (x, y) == tuple(start)
            size = RING if ring else CIRCLE
            axes.plot([x], [y], linestyle="none", markersize=size, zorder=7.9 if ring else 8, gid=name, **look)
            if not ring:
                axes.text(x, y, letter, ha="center", va="center_baseline", fontsize=7.5, weight="bold", zorder=9)
        if len(places):
            entry = f"{letter}: {name}{more}"
            handles.append(Line2D([], [], linestyle="none", markersize=8, label=entry, **look))
    return handles
