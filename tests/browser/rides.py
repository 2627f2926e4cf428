"""A room with all that a ride shows, a front of two ways through it, and what is seen of it, worked out apart."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from playwright.sync_api import Page

import hpop
from hpop.criteria.costs import trajectory_costs
from hpop.world.content.content import Landmark, Person, Zone

EYE = 1.2
MARKUP = "</script><b>owls</b>"
WAYS = {
    "straight": [(1, 1), (9, 1)],
    "round": [(1, 1), (1, 6), (9, 6), (9, 1)],
}
PRISMS = [
    (shapely.box(4, 1.5, 6, 4.5), (None, None)),
    (shapely.Polygon([(2, 3), (3, 3.2), (2.8, 4), (1.9, 3.9)]), (0.0, 0.8)),  # looked over
    (shapely.box(7, 5, 8, 5.6), (2.0, 2.5)),  # looked under
    (shapely.box(6.6, 2, 7.6, 3.5).difference(shapely.box(6.8, 2.2, 7.4, 3.3)), (0.0, 1.9)),
    (shapely.Point(3.4, 2.0).buffer(0.3, quad_segs=8), (0.4, 2.2)),
]
PEOPLE = (
    Person(2.2, 6.9, yaw=-1.2, name="Ada"),
    Person(9.4, 4.0, yaw=3.0, velocity=(-0.1, 0.15), radius=0.3, name="Bo"),
)
LANDMARKS = (Landmark(9.5, 7.0, z=1.4, facing=-2.2, name=MARKUP), Landmark(0.6, 4.5, z=1.3, name="door"))


def room() -> hpop.World:
    """Return a room: prisms of several heights, one with a hole; a wall; people, one walking; plates; a zone."""
    wall = shapely.box(-0.2, -0.2, 10.2, 8.2).difference(shapely.box(0, 0, 10, 8))
    world = hpop.World.from_polygons([*PRISMS, (wall, (None, None))], extent=shapely.box(0, 0, 10, 8))
    zone = Zone("speed", shapely.box(0.2, 5, 3, 7.8), limit=0.5, name="slow")
    return world.with_content(people=PEOPLE, landmarks=LANDMARKS, zones=[zone])


def problem_of(world: hpop.World, model: object = None) -> hpop.Problem:
    robot = model or hpop.DifferentialDrive(radius=0.2, camera_height=EYE)
    return hpop.Problem(
        world=world, model=robot, start=(1, 1, 0), goal=(9, 1, 0), criteria=["turns", "length", "obstruction"]
    )


def through(model: object, points: list[tuple[float, float]]) -> hpop.Trajectory:
    ahead = [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in pairwise(points)]
    poses = [(*points[0], 0.0), *((x, y, yaw) for (x, y), yaw in zip(points[1:], [*ahead[1:], 0.0], strict=True))]
    return hpop.Trajectory.from_poses(model, poses)


def front_of(problem: hpop.Problem, through_points: Mapping[str, list[tuple[float, float]]] = WAYS) -> hpop.Front:
    """Return a front of two paths: row 0 is straight, row 1 goes round."""
    ways = [through(problem.model, points) for points in through_points.values()]
    return hpop.Front.of(
        trajectory_costs(problem.criteria, ways, problem.world),
        ways,
        names=[c.name for c in problem.criteria],
        units=[c.unit for c in problem.criteria],
        quanta=[c.quantum for c in problem.criteria],
        status="complete",
        certificate="made by hand",
    )


class Seen(NamedTuple):
    """Something at the height of the eye.

    number  in the order of obstacles, people, landmarks, from 1
    shape   in the plane
    """

    number: int
    shape: shapely.Geometry


def at_eye(world: hpop.World, eye: tuple[float, float], t: float) -> list[Seen]:
    """Return everything that a level ray from the eye can meet at a time: sections at the eye's height."""
    found = []
    for number, obstacle in enumerate(world.obstacles, 1):
        if obstacle.z_min < EYE < obstacle.z_max:
            found.append(Seen(number, obstacle.polygon))
    number = len(world.obstacles)
    for person in world.content.people:
        number += 1
        walked = t if person.until is None else min(t, person.until)  # up to a wall, where they stay
        x, y = person.x + person.velocity[0] * walked, person.y + person.velocity[1] * walked
        up = (EYE - 1.12) / 0.38  # in the trunk, an ellipsoid from 0.74 to 1.50 m
        found.append(Seen(number, shapely.Point(x, y).buffer(person.radius * math.sqrt(1 - up * up), quad_segs=64)))
    for mark in world.content.landmarks:
        number += 1
        if abs(mark.z - EYE) < 0.25:
            towards = math.atan2(eye[1] - mark.y, eye[0] - mark.x) if mark.facing is None else mark.facing
            dx, dy = -0.4 * math.sin(towards), 0.4 * math.cos(towards)
            found.append(Seen(number, shapely.LineString([(mark.x - dx, mark.y - dy), (mark.x + dx, mark.y + dy)])))
    return found


def horizon(world: hpop.World, eye: tuple[float, float], yaw: float, t: float, columns: int) -> np.ndarray:
    """Numbers (columns,) of what level rays meet first, the heading in the middle, to the left what is at the left."""
    bearings = yaw + (0.5 - (np.arange(columns) + 0.5) / columns) * 2.0 * math.pi
    far = np.array(eye) + 100.0 * np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    rays = shapely.linestrings(np.stack([np.broadcast_to(eye, far.shape), far], axis=1))
    here = shapely.Point(eye)
    nearest, numbers = np.full(columns, np.inf), np.zeros(columns, dtype=int)
    for number, shape in at_eye(world, eye, t):
        edges = shape.boundary if shape.geom_type == "Polygon" else shape
        away = shapely.distance(here, shapely.intersection(rays, edges))  # NaN where there is none
        closer = away < nearest
        nearest[closer], numbers[closer] = away[closer], number
    return numbers


def ready(page: Page) -> Page:
    """Return the page once it has drawn."""
    page.locator("html[data-ready=yes]").wait_for(state="attached")
    return page
