"""Visits of a tour's stops: which of them a trajectory visits, in what order and when.

They are computed from the trajectory alone, in one way for all planners.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from hpop.base.arrays import BoolArray, Column
from hpop.criteria.base import Criterion, index_of_role
from hpop.goals import Goal
from hpop.goals.approach import hidden_share, sees_target
from hpop.models.rigid import field_of_view, height_varies
from hpop.motions import HOLD, States
from hpop.world.sight import sight_in_space
from hpop.world.sight.bearings import in_view
from hpop.world.sight.visibility import sees

if TYPE_CHECKING:
    from hpop.criteria.performance.landmarks import StopsMissed
    from hpop.goals.tour import Tour
    from hpop.goals.tour_stop import TourStop
    from hpop.motions import Model, Pose
    from hpop.trajectories.trajectory import Trajectory
    from hpop.world import World
    from hpop.world.content.content import Landmark

SAME = 1e-6  # m or s: tolerance of distances and of dwell times
Weights = Mapping[str, float]
"""Weights of optional stops, by name; an optional stop without an entry has weight 1."""


def landmark_seen(
    world: World,
    model: Model,
    camera: Pose,
    size: int,
    landmark: Landmark,
    *,
    far: float,
    view: tuple[Column, Column] | None = None,
) -> BoolArray:
    """Return whether the camera sees a landmark from each of its poses (N,).

    It does if the landmark is in the field of view, not hidden and near enough, and the camera is in front of it.

    size  number N of poses
    far   m    largest distance, in three dimensions
    view  rad  horizontal and vertical angle of view, numbers or columns (N,); None for the model's two angles
    """
    view = view or field_of_view(model)
    if height_varies(model):
        visible = sight_in_space.sees(world, camera, landmark, size, far=far)
        return np.asarray(visible * sight_in_space.in_view(camera, landmark, size, *view) > 0.0)
    seen = sees(world, camera, landmark, far=far)
    viewed = in_view(camera, landmark, *view)
    return np.asarray(seen & (viewed > 0.0), dtype=bool)


def hidden_targets(world: World, model: Model, states: States, target: tuple[float, float, float]) -> BoolArray:
    """Return whether solids of the world hide a target, a ball of 5 cm radius, completely from the camera (N,)."""
    share = hidden_share(world, model, states, target, by_robot=False)
    return np.asarray(share >= 1.0 - 1e-9)


def in_stop(stop: TourStop, world: World, model: Model, states: States) -> BoolArray:
    """Return a mask (N,) of the states that count as being at a stop of a tour.

    At such a state the robot is near enough to the stop's position, sees its landmark, or reaches its target. The tour
    must have been checked by :meth:`hpop.goals.Tour.on`. A state with an open coordinate (NaN) counts only for stops
    that are given by a position.
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
    """Return a mask (N,) of the states that reach a goal and see its ``looked_at`` position, if the goal has one."""
    found = np.zeros(states.size, dtype=bool)
    for goal in target.alternatives():
        there = np.flatnonzero(goal.reached(model, states) & ~found)
        if goal.looked_at is not None and there.size:
            some = states.take(there)
            if goal.visible:
                there = there[sees_target(world, model, some, goal.looked_at)]
            else:
                there = there[~hidden_targets(world, model, some, goal.looked_at)]
        found[there] = True
    return found


@dataclass(frozen=True)
class Visit:
    """Visit of one stop of a tour.

    stop        index of the stop in its tour
    begin, end  s  the robot stands at the stop from begin to end; equal for a stop without dwell time
    """

    stop: int
    begin: float
    end: float


@dataclass(frozen=True)
class Visits:
    """Visits of a tour's stops by one trajectory, in order of time.

    missed    sum of the weights of the optional stops that are not visited; visits are assigned so that it is smallest
    complete  True if all stops that are not optional are visited
    """

    visits: tuple[Visit, ...] = ()
    missed: float = field(default=0.0, compare=False)
    complete: bool = True

    def described(self, tour: Tour) -> list[dict[str, Any]]:
        """Return the visits for JSON: for each, the name of the stop, begin and end in s."""
        return [{"stop": tour.names[v.stop], "begin": v.begin, "end": v.end} for v in self.visits]


@dataclass(frozen=True)
class _Progress:
    """Partial assignment of visits to a trajectory.

    missed  weight of the optional stops that were skipped so far
    used    s, time of the current standstill that is already used for visits
    visits  visits so far
    """

    missed: float = 0.0
    used: float = 0.0
    visits: tuple[Visit, ...] = ()


def visits_of(tour: Tour, trajectory: Trajectory, inside: BoolArray, weights: Weights) -> Visits:
    """Return the visits of a trajectory: those that miss the smallest weight of optional stops, as early as possible.

    Stops are visited one after another, in an order that the tour allows. A visit takes the dwell time of the stop, for
    which the robot must stand at the stop. A stop without dwell time can be visited at any state where a motion begins
    or ends.

    inside   (s, n+1)  whether each of the n+1 states of the trajectory counts as being at each of s stops
    weights            weights of optional stops
    """
    best = {0: _Progress()}  # by layer of the tour, which stands for the set of stops that have been visited
    stops_at: dict[int, set[int]] = {}
    for stop, state in np.argwhere(inside).tolist():
        stops_at.setdefault(state, set()).add(stop)
    for state, begin, lasts in _stands(trajectory):
        here = stops_at.get(state)
        if here is None:
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
        if tour.has_many_layers:
            best = _undominated(tour, best)
    required = set(range(len(tour.stops))).difference(tour.optional)
    endings = {layer for layer in best if required <= tour.layers[layer]}
    complete = bool(endings)
    ends = []
    for layer, now in best.items():
        left = [j for j in tour.optional if j not in tour.layers[layer]]
        if layer in endings or not complete:
            ends.append((now.missed + weight_of(tour, left, weights), -len(now.visits), now.visits))
    missed, _, visits = min(ends, key=lambda end: end[:2])
    return Visits(visits, missed, complete)


def _undominated(tour: Tour, best: Mapping[int, _Progress]) -> dict[int, _Progress]:
    """Return ``best`` without the layers that cannot lead to a better result than another layer.

    A layer is a set of stops that were visited or skipped. It is dropped if another layer has all these stops and no
    larger ``missed``: every later visit is then possible from the other layer, or not needed any more.
    """
    kept: dict[int, _Progress] = {}
    for layer in sorted(best, reverse=True):  # larger sets first
        done, missed = tour.layers[layer], best[layer].missed
        if not any(done <= tour.layers[other] and now.missed <= missed for other, now in kept.items()):
            kept[layer] = best[layer]
    return kept


def weight_of(tour: Tour, stops: Sequence[int], weights: Weights) -> float:
    """Return the sum of the weights of some optional stops, given by their indices in the tour."""
    return sum(weights.get(tour.names[i], 1.0) for i in stops)


def missed_weights(criteria: Sequence[Criterion]) -> Weights:
    """Return the weights of optional stops, by name, that the criterion stops_missed has.

    Returns {} if stops_missed is not among the criteria, or has no weights.
    """
    missed = index_of_role("stops_missed", criteria)
    return {} if missed is None else cast("StopsMissed", criteria[missed]).weights or {}


def _stands(trajectory: Trajectory) -> Iterator[tuple[int, float, float]]:
    """Yield index and time, s, of each state before, between and after moves, and how long the robot stands there, s.

    Of the equal states before, between and after consecutive holds, only the first is yielded.
    """
    times, kinds = trajectory.times.tolist(), trajectory.kinds
    first = 0
    for state in range(len(kinds) + 1):
        if state == len(kinds) or kinds[state] != HOLD.kind:
            yield first, times[first], times[state] - times[first]
            first = state + 1


def all_visits(
    tour: Tour, world: World, trajectories: Sequence[Trajectory], weights: Weights | None = None
) -> list[Visits]:
    """Return the visits of a tour's stops by each of some trajectories of one model."""
    if not trajectories:
        return []
    model = trajectories[0].model
    sizes = [len(trajectory) + 1 for trajectory in trajectories]
    names = model.space.names
    states = States(**{name: np.concatenate([getattr(t.states, name) for t in trajectories]) for name in names})
    inside = np.stack([in_stop(stop, world, model, states) for stop in tour.stops])
    parts = np.split(inside, np.cumsum(sizes)[:-1], axis=1)
    return [visits_of(tour, t, part, weights or {}) for t, part in zip(trajectories, parts, strict=True)]
