"""Social metrics that studies of robots among people report; they measure a trajectory and are not minimised."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.options import LEAST, MOST, real
from hpop.criteria.others import checked_radius, reach
from hpop.criteria.others.encounters import time_to_collision
from hpop.errors import CriterionError
from hpop.motions.quadrature import JUST
from hpop.trajectories.history import SampledTrajectory
from hpop.world.content.proxemics import HALL, offset

if TYPE_CHECKING:
    from hpop.trajectories.trajectory import Trajectory
    from hpop.world import World
    from hpop.world.content.people import Person

STEP = 0.01  # s, default time between samples
COMPLIANT = 0.5  # m, smallest gap that respects people's space


@dataclass(frozen=True)
class SocialMetrics:
    """Metrics of Francis et al. 2023 (Principles and guidelines for evaluating social robot navigation algorithms).

    People are at their predicted positions while they are present. If a person has several predicted futures, the
    person counts as being at all of their positions: distances and times are the smallest over the futures.

    min_human_distance       m  smallest gap between the surfaces of robot and people; ∞ without people, negative in a
                                collision
    space_compliance         1  share of the time in which all people are at least ``COMPLIANT`` = 0.5 m away
    least_time_to_collision  s  smallest time to collision; ∞ if robot and people are never on a collision course
    path_efficiency          1  shortest length / max(length, shortest length), as in SPL for one success; None if no
                                shortest length is given
    """

    min_human_distance: float
    space_compliance: float
    least_time_to_collision: float
    path_efficiency: float | None


def social_metrics(
    trajectory: Trajectory,
    world: World,
    *,
    shortest_length: float | None = None,
    robot_radius: float | None = None,
    step: float = STEP,
) -> SocialMetrics:
    """Measure the social metrics of a trajectory; pass its ``execution()`` to measure the robot's real motion.

    shortest_length  m  length of the shortest path from start to goal, for the path efficiency
    robot_radius     m  radius of the robot about its axis; by default the largest reach of its parts
    step             s  between samples; the ends of motions, and moments at which people turn, come or leave, are added

    Raises CriterionError if the step or the shortest length is not positive.
    """
    robot_radius = checked_radius(robot_radius)
    if shortest_length is not None:
        kind = "a positive length in m"
        shortest_length = real("shortest_length", shortest_length, LEAST, MOST, kind, error=CriterionError)
    radius = reach(trajectory.model, robot_radius)
    middles = _middles(trajectory, step)
    turns = world.content.kinks[(world.content.kinks > 0) & (world.content.kinks <= trajectory.duration)]
    times = np.unique(np.concatenate([middles, trajectory.times, turns, turns - JUST]))
    moments = SampledTrajectory(trajectory, times)
    base, velocity = moments.base, moments.twist("base").velocity
    least = np.inf
    for person in _one_per_future(world):
        px, py = offset(person, base.x, base.y, times)
        walks_x, walks_y = person.velocity_at(times)
        left = time_to_collision(px, py, velocity[0] - walks_x, velocity[1] - walks_y, radius + person.radius)
        least = min(least, float(np.where(person.there(times), left, np.inf).min()))
    length = sum(float(motions.base.length.sum()) for _, motions in trajectory.batches(world))
    return SocialMetrics(
        min_human_distance=float(_gaps(trajectory, world, times, radius).min()),
        space_compliance=float(np.mean(_gaps(trajectory, world, middles, radius) >= COMPLIANT)),
        least_time_to_collision=least,
        path_efficiency=None if shortest_length is None else shortest_length / max(length, shortest_length),
    )


def zone_fractions(
    trajectory: Trajectory, world: World, *, robot_radius: float | None = None, step: float = STEP
) -> dict[str, float]:
    """Return which share of the time the robot is in the "intimate", "personal", "social" and "public" zone.

    The zone is that of the nearest person. Zones have sharp borders here, and gaps are measured between surfaces of
    robot and person. Samples are ``step`` seconds apart.
    """
    robot_radius = checked_radius(robot_radius)
    gaps = _gaps(trajectory, world, _middles(trajectory, step), reach(trajectory.model, robot_radius))
    zone = np.searchsorted(list(HALL.values()), gaps, side="right")  # a zone ends where the next begins
    shares = np.bincount(zone, minlength=len(HALL) + 1) / gaps.size
    return dict(zip((*HALL, "public"), shares.tolist(), strict=True))


def _middles(trajectory: Trajectory, step: float) -> FloatArray:
    """Return the middles, s, of equal intervals of at most ``step`` s that divide a trajectory's duration."""
    step = real("step", step, LEAST, MOST, "a positive time in s", error=CriterionError)
    count = max(1, int(np.ceil(trajectory.duration / step)))
    return np.asarray((np.arange(count) + 0.5) * (trajectory.duration / count))


def _gaps(trajectory: Trajectory, world: World, times: FloatArray, radius: float) -> FloatArray:
    """Return the gap (N,), m, between robot and nearest person (surfaces), at times (N,), s; inf without a person."""
    base = trajectory.model.pose("base", trajectory.at(times))
    nearest = np.full(times.shape, np.inf)
    for person in _one_per_future(world):
        gap = np.hypot(*offset(person, base.x, base.y, times)) - person.radius - radius
        nearest = np.minimum(nearest, np.where(person.there(times), gap, np.inf))
    return nearest


def _one_per_future(world: World) -> Iterator[Person]:
    """Yield each predicted future of each person as a person of its own."""
    return (hypothesis for person in world.content.people for _, hypothesis in person.hypotheses)
