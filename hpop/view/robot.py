"""The robot itself, in outline, where its paths begin and end: of models that say where their parts are in space."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.patches import Patch
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import FloatArray
from hpop.motions import Model, States
from hpop.trajectories.trajectory import Trajectory
from hpop.view.ground import outline
from hpop.view.style import Mark
from hpop.world import Solid, Sphere

Flatten = Callable[[FloatArray], FloatArray]  # points in space (..., 3) as they are in a picture (..., 2)
LOOK: dict[str, Any] = {"facecolor": ("#5b7aa5", 0.18), "edgecolor": ("#34507a", 0.75), "linewidth": 0.8}


def from_above(points: FloatArray) -> FloatArray:
    """Points in space (..., 3) as they are on a map (..., 2)."""
    return points[..., :2]


def solid_outline(solid: Solid, flatten: Flatten) -> Polygon:
    """The outline of a convex solid in a picture, m."""
    if isinstance(solid.shape, Sphere):
        return shapely.Point(flatten(solid.pose[:3, 3])).buffer(solid.shape.radius)
    return shapely.convex_hull(shapely.MultiPoint(flatten(solid.corners)))  # type: ignore[return-value]


def robot_outlines(trajectories: Sequence[Trajectory], flatten: Flatten) -> list[BaseGeometry]:
    """Outlines, m, of the robot at both ends of the first of some trajectories; none of models without ``bodies``."""
    if not trajectories:
        return []
    return outlines_at(trajectories[0].model, trajectories[0].states.take([0, -1]), flatten)


def outlines_at(model: Model, states: States, flatten: Flatten) -> list[BaseGeometry]:
    """Outlines, m, of a robot in states (N,), from where its ``bodies`` are."""
    placed = [[Solid(shape, pose) for pose in poses] for shape, poses in model.bodies(states)]
    return [
        shapely.union_all([solid_outline(solid, flatten) for solid in parts]) for parts in zip(*placed, strict=True)
    ]


def corners_of(outlines: Sequence[BaseGeometry]) -> FloatArray:
    """Points (N, 2), m, round which a picture of them reaches."""
    return shapely.get_coordinates(np.array(outlines, dtype=object))


def draw_robot(axes: Axes, outlines: Sequence[BaseGeometry], named: Sequence[Mark]) -> list[Patch]:
    """Draw outlines of the robot at both ends of the first that is named; returns the legend entry."""
    if not outlines:
        return []
    paths = [outline(geometry) for geometry in outlines]
    axes.add_collection(PathCollection(paths, zorder=2.5, gid="robot", **LOOK), autolim=False)
    return [Patch(**LOOK, label=f"the robot at both ends: {named[0].names[0]}")]
