"""Worlds drawn at random for checks, and the same world in another frame."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from hpop.base.arguments import checked_arguments
from hpop.world import Ground, Obstacle, World, pose_at
from hpop.world.content.content import Landmark, Person, Zone

FRAME = (-7.3, 4.1, 0.7)  # m, m, rad: where another frame lies


@checked_arguments
def random_world(rng: np.random.Generator) -> World:
    """A room of 12 x 9 m with boxes of random places, sizes and heights, standing people, landmarks and zones."""
    corners = rng.uniform((0.5, 0.5), (10.0, 7.0), size=(8, 2))
    sizes = rng.uniform(0.3, 1.5, size=(8, 2))
    tops = rng.uniform(0.5, 2.5, size=8)
    boxes = [(shapely.box(*c, *(c + s)), (0.0, float(top))) for c, s, top in zip(corners, sizes, tops, strict=True)]
    places = rng.uniform((1.0, 1.0), (11.0, 8.0), size=(6, 2)).tolist()
    yaws = rng.uniform(-np.pi, np.pi, size=5).tolist()
    line = shapely.LineString(rng.uniform((1.0, 1.0), (11.0, 8.0), size=(3, 2)))
    return World.from_polygons(boxes, extent=shapely.box(0.0, 0.0, 12.0, 9.0)).with_content(
        people=[Person(x, y, yaw) for (x, y), yaw in zip(places[:3], yaws[:3], strict=True)],
        groups=[(0, 1)],
        landmarks=[Landmark(x, y, facing=facing) for (x, y), facing in zip(places[3:], [None, *yaws[3:]], strict=True)],
        zones=[
            Zone("speed", shapely.box(2.0, 2.0, 8.0, 6.0), limit=0.5),
            Zone("one-way", line.buffer(1.5), path=line),
        ],
    )


@checked_arguments
def reframed(world: World) -> World:
    """A world of polygons and solids turned and shifted by ``FRAME``, content and all."""

    def place(geometry: Any) -> Any:
        return shapely.transform(geometry, lambda points: np.stack(in_frame(points[:, 0], points[:, 1]), axis=1))

    def pose(thing: Any, facing: str) -> dict[str, Any]:
        x, y = in_frame(thing.x, thing.y)
        angle = getattr(thing, facing)
        return {"x": float(x), "y": float(y), facing: None if angle is None else angle + FRAME[2]}

    content = world.content
    prisms = [Obstacle(place(prism.polygon), *prism.heights) for prism in world.obstacles if prism.solid is None]
    frame = pose_at((*FRAME[:2], 0.0), rpy=(0.0, 0.0, FRAME[2]))
    solids = [replace(solid, pose=frame @ solid.pose) for solid in world.ground.solids]
    return World(Ground(tuple(prisms), extent=place(world.extent), solids=tuple(solids))).with_content(
        people=[replace(person, **pose(person, "yaw")) for person in content.people],
        groups=content.groups,
        landmarks=[replace(landmark, **pose(landmark, "facing")) for landmark in content.landmarks],
        zones=[
            replace(zone, area=place(zone.area), path=None if zone.path is None else place(zone.path))
            for zone in content.zones
        ],
    )


def in_frame(x: Any, y: Any) -> tuple[Any, Any]:
    """Where points are in the other frame."""
    cos, sin = np.cos(FRAME[2]), np.sin(FRAME[2])
    return cos * x - sin * y + FRAME[0], sin * x + cos * y + FRAME[1]
