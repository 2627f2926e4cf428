"""Visits of stops: which states are in the set of a stop, and which stops a trajectory visits, in what order and when.

All of this is computed from the trajectory alone, whatever the planner.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import BoolArray
from hpop.goals import Goal
from hpop.models.camera import field_of_view, height_varies
from hpop.motions import HOLD, States
from hpop.world.geometry.rays_in_space import Surfaces, rows, surfaces_of, towards_ball
from hpop.world.sight import sight_in_space
from hpop.world.sight.bearings import in_view
from hpop.world.sight.visibility import sees

if TYPE_CHECKING:
    from hpop.goals.tour import Tour, TourStop
    from hpop.motions import Model, Pose
    from hpop.trajectories.trajectory import Trajectory
    from hpop.world import World
    from hpop.world.content.content import Landmark

TARGET_RADIUS = 0.05  # m: radius of the ball about a target, part of which should be visible
RAYS = 37
SAME = 1e-6  # m or s by which a position or a dwell may fall short
Weights = Mapping[str, float]
"""Weights of optional stops, by name; 1 for those left out."""


def landmark_seen(
    world: World, model: Model, camera: Pose, size: int, landmark: Landmark, *, far: float, fov: float | None = None
) -> BoolArray:
    """Return whether the camera sees a landmark in each of its poses (N,): in view, in front, near and unobstructed.

    size  number N of poses
    far   m    range of sight in three dimensions
    fov   rad  horizontal angle of view that replaces that of the model
    """
    view = field_of_view(model, fov)
    if height_varies(model):
        visible = sight_in_space.sees(world, camera, landmark, size, far=far)
        return np.asarray(visible * sight_in_space.in_view(camera, landmark, size, *view) > 0.0)
    seen = sees(world, camera, landmark, far=far)
    viewed = in_view(camera, landmark, *view)
    return np.asarray(seen & (viewed > 0.0), dtype=bool)


def hidden_targets(world: World, model: Model, states: States, target: tuple[float, float, float]) -> BoolArray:
    """Return whether solids hide all of a ball about a target from cameras in states (N,)."""
    pose = model.pose("camera", states)
    camera = rows((pose.x, pose.y, pose.z), states.size)
    share = surfaces_of(world).blocked(
        Surfaces.of([]), np.empty((0, states.size, 4, 4)), camera, *towards_ball(camera, target, TARGET_RADIUS, RAYS)
    )
    return np.asarray(share >= 1.0 - 1e-9)


def in_stop(stop: TourStop, world: World, model: Model, states: States) -> BoolArray:
    """Return which states (N,) are in the set of a stop of a tour that was checked by :meth:`hpop.goals.Tour.on`.

    A state with a free coordinate (NaN) is in the set if its position suffices.
    """
    if stop.at is not None:
        x, y = stop.at
        return np.asarray(np.hypot(states.x - x, states.y - y) <= float(stop.within or 0.0) + SAME)
    known = np.flatnonzero(~np.any([np.isnan(column) for column in states.__dict__.values()], axis=0))
    inside, some = np.zeros(states.size, dtype=bool), states.take(known)
    if stop.landmark is not None:
        mark = next(mark for mark in world.content.landmarks if mark.name == stop.landmark)
        far = float(stop.within or 0.0) + SAME
        inside[known] = landmark_seen(world, model, model.pose("camera", some), some.size, mark, far=far)
    elif stop.target is not None:
        inside[known] = _reached_and_seen(stop.target, world, model, some)
    return inside


def _reached_and_seen(target: Goal, world: World, model: Model, states: States) -> BoolArray:
    """Return which states (N,) reach a goal from which its target, if it has one, is visible."""
    found = np.zeros(states.size, dtype=bool)
    for goal in target.alternatives():
        there = np.flatnonzero(goal.reached(model, states) & ~found)
        if goal.looked_at is not None and there.size:
            there = there[~hidden_targets(world, model, states.take(there), goal.looked_at)]
        found[there] = True
    return found


@dataclass(frozen=True)
class Visit:
    """Visit of a stop.

    stop        index of the stop in its tour
    begin, end  s  the robot stands in the stop's set from begin to end; a visit without dwell has begin = end
    """

    stop: int
    begin: float
    end: float


@dataclass(frozen=True)
class Visits:
    """Visits of a trajectory in order of time, with the least weight of missed optional stops that it allows.

    missed    weight of the optional stops that are not visited
    complete  whether all stops that are not optional are visited
    """

    visits: tuple[Visit, ...] = ()
    missed: float = field(default=0.0, compare=False)
    complete: bool = True

    def described(self, tour: Tour) -> list[dict[str, Any]]:
        """Return the visits as JSON: name of the stop, begin and end in s."""
        return [{"stop": tour.names[v.stop], "begin": v.begin, "end": v.end} for v in self.visits]


@dataclass(frozen=True)
class _Progress:
    """Progress along a trajectory: visits so far, weight of skipped stops, and time used of the current stand, s."""

    missed: float = 0.0
    used: float = 0.0
    visits: tuple[Visit, ...] = ()


def visits_of(tour: Tour, trajectory: Trajectory, inside: BoolArray, weights: Weights) -> Visits:
    """Return the visits of a trajectory, as early as possible among those with the least weight of missed stops.

    Stops are visited one after another, in the order of the tour: each takes its dwell of the time for which the robot
    stands in its set. A stop without dwell is visited where a motion begins or ends.

    inside  (s, n+1)  whether each state of the trajectory is in the set of each stop
    """
    best = {0: _Progress()}  # by layer
    for state, begin, lasts in _stands(trajectory):
        here = set(np.flatnonzero(inside[:, state]).tolist())
        if not here:
            continue
        reached = [(layer, _Progress(now.missed, 0.0, now.visits)) for layer, now in best.items()]
        known: dict[tuple[int, float], float] = {}
        for layer, now in reached:  # grows
            for step in tour.steps[layer]:
                used = now.used + tour.stops[step.stop].dwell
                if step.stop not in here or used > lasts + SAME:
                    continue
                missed = now.missed + weight_of(tour, step.skipped, weights)
                if known.get((step.layer, round(used, 6)), np.inf) <= missed:
                    continue
                known[step.layer, round(used, 6)] = missed
                visit = Visit(step.stop, begin + now.used, begin + min(used, lasts))
                later = _Progress(missed, used, (*now.visits, visit))
                reached.append((step.layer, later))
                if step.layer not in best or missed < best[step.layer].missed:
                    best[step.layer] = later
    endings = dict(tour.endings)
    complete = bool(best.keys() & endings.keys())
    ends = []
    for layer, now in best.items():
        left = [j for j in tour.optional if j not in tour.layers[layer]]
        if layer in endings or not complete:
            ends.append((now.missed + weight_of(tour, left, weights), -len(now.visits), now.visits))
    missed, _, visits = min(ends, key=lambda end: end[:2])
    return Visits(visits, missed, complete)


def weight_of(tour: Tour, stops: Sequence[int], weights: Weights) -> float:
    """Return the sum of the weights of some optional stops, given by index."""
    return sum(weights.get(tour.names[i], 1.0) for i in stops)


def _stands(trajectory: Trajectory) -> Iterator[tuple[int, float, float]]:
    """Yield the states at which motions begin or end, with the time, s, and for how long the robot stands there, s."""
    times, kinds = trajectory.times.tolist(), trajectory.kinds
    first = 0
    for state in range(len(kinds) + 1):
        if state == len(kinds) or kinds[state] != HOLD.kind:
            yield first, times[first], times[state] - times[first]
            first = state + 1


def all_visits(
    tour: Tour, world: World, trajectories: Sequence[Trajectory], weights: Weights | None = None
) -> list[Visits]:
    """Return the visits of trajectories of one model."""
    if not trajectories:
        return []
    model = trajectories[0].model
    sizes = [len(trajectory) + 1 for trajectory in trajectories]
    names = model.space.names
    states = States(**{name: np.concatenate([getattr(t.states, name) for t in trajectories]) for name in names})
    inside = np.stack([in_stop(stop, world, model, states) for stop in tour.stops])
    parts = np.split(inside, np.cumsum(sizes)[:-1], axis=1)
    return [visits_of(tour, t, part, weights or {}) for t, part in zip(trajectories, parts, strict=True)]
