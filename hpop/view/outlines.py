"""Outlines: of the robot at both ends of a path, with the directions in which its camera looks, and of obstacles.

Obstacles are all of them on a map, or those near some paths in a view from the side. A camera in a robot's hand moves
over, under and between obstacles, so a map of its paths shows obstacles of all heights.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection, PathCollection, PolyCollection
from matplotlib.patches import Patch, Wedge
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import FloatArray
from hpop.base.math import wrap
from hpop.models.rigid import field_of_view
from hpop.motions import Model, ModelInTime, Pose, States
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory
from hpop.view.ground import View, draw_obstacles, outline
from hpop.view.marks import is_held
from hpop.view.style import QUIET, Heights, Mark, positions
from hpop.world import Solid, Sphere, World

Flatten = Callable[[FloatArray], FloatArray]  # points in space (..., 3) as they are in a picture (..., 2)
LOOK: dict[str, Any] = {"facecolor": ("#5b7aa5", 0.18), "edgecolor": ("#34507a", 0.75), "linewidth": 0.8}
WATCHED_LOOK: dict[str, Any] = {"facecolor": ("#b5894a", 0.18), "edgecolor": ("#7d5a24", 0.75), "linewidth": 0.8}


def from_above(points: FloatArray) -> FloatArray:
    """Project points in space (..., 3) to a map (..., 2), by dropping the height."""
    return points[..., :2]


def solid_outline(solid: Solid, flatten: Flatten) -> Polygon:
    """Return the outline of a convex solid, m, after projection to a picture by ``flatten``."""
    if isinstance(solid.shape, Sphere):
        return shapely.Point(flatten(solid.pose[:3, 3])).buffer(solid.shape.radius)
    return shapely.convex_hull(shapely.MultiPoint(flatten(solid.corners)))  # type: ignore[return-value]


def robot_outlines(trajectories: Sequence[Trajectory], flatten: Flatten) -> list[BaseGeometry]:
    """Return the robot's outlines, m, at start and end of the first trajectory, then those of a working arm beside it.

    There are none for models without ``bodies``.
    """
    if not trajectories:
        return []
    model, ends = trajectories[0].model, trajectories[0].states.take([0, -1])
    return outlines_at(model, ends, flatten) + outlines_at(model, ends, flatten, watched=True)


def outlines_at(model: Model, states: States, flatten: Flatten, *, watched: bool = False) -> list[BaseGeometry]:
    """Return the robot's outlines, m, in states (N,), by its ``bodies``.

    watched  whether to return the outlines of the working arm that the robot watches instead; [] if there is none
    """
    bodies, own = model.bodies(states), None
    if "time" in model.provides:
        own = len(cast(ModelInTime, model).timeless.bodies(states))
    elif watched:
        return []
    placed = [[Solid(shape, pose) for pose in poses] for shape, poses in (bodies[own:] if watched else bodies[:own])]
    return [
        shapely.union_all([solid_outline(solid, flatten) for solid in parts]) for parts in zip(*placed, strict=True)
    ]


def corners_of(outlines: Sequence[BaseGeometry]) -> FloatArray:
    """Return all corner points (N, 2), m, of some outlines."""
    return shapely.get_coordinates(np.array(outlines, dtype=object))


def draw_robot(axes: Axes, outlines: Sequence[BaseGeometry], named: Sequence[Mark]) -> list[Patch]:
    """Draw the robot's outlines at both ends of the first named trajectory; return the legend entry."""
    at_ends = f"at both ends: {named[0].names[0]}" if named else ""
    return draw_outlines(axes, outlines[:2], f"the robot {at_ends}") + draw_outlines(
        axes, outlines[2:], f"the working arm {at_ends}", watched=True
    )


def draw_outlines(
    axes: Axes, outlines: Sequence[BaseGeometry], label: str, *, watched: bool = False, zorder: float = 2.5
) -> list[Patch]:
    """Draw outlines of the robot, or (``watched``) of a working arm that it watches; return the legend entry."""
    if not outlines:
        return []
    look, gid = (WATCHED_LOOK, "working arm") if watched else (LOOK, "robot")
    paths = [outline(geometry) for geometry in outlines]
    axes.add_collection(PathCollection(paths, zorder=zorder, gid=gid, **look), autolim=False)
    return [Patch(**look, label=label)]


REACH = 0.045  # length of a wedge, as a share of the map's longer side
APART = 1.5  # distance between wedges along the path, as a multiple of REACH
CONE_REACH = 0.07  # length of a cone, as a share of the map's longer side
CONES_APART = 3.0  # distance between cones along the path, as a multiple of CONE_REACH
RIM = np.linspace(-1.0, 1.0, 9)  # shares of half an angle of view at which a cone's rim is sampled
AHEAD = 1 + RIM.size**2 // 2  # index of the middle of the view among the points of a cone
POINTER = math.radians(16.0)  # width of the wedge of an all-round camera
SAMPLES = 4000  # sampled times of a trajectory
ASIDE = 1e-6  # rad: tolerance of "the camera looks along the base"


def looks_aside(model: Model, trajectories: list[Trajectory]) -> bool:
    """Return whether pictures must show where the camera looks: if its view is limited, or not along the heading."""
    if "camera" not in model.provides:
        return False
    return "base" not in model.provides or model.field_of_view is not None or turns_away(model, trajectories)


def turns_away(model: Model, trajectories: Sequence[Trajectory]) -> bool:
    """Return whether the camera looks up, down, or to the side of the base's heading in a state of the trajectories.

    The states are those between motions. The robot must have a base.
    """
    poses = ((model.pose("camera", t.states), model.pose("base", t.states)) for t in trajectories)
    return any((np.abs(wrap(camera.yaw - base.yaw)) > ASIDE).any() or camera.pitch.any() for camera, base in poses)


def draw_sight(
    axes: Axes, trajectory: Trajectory, colour: str, view: View, *, zorder: float, gid: str, tour: bool = False
) -> None:
    """Draw where the camera looks, from above: as wedges for a robot with a base, as cones for a camera in a hand.

    They are drawn at the start, at even distances along the path, and at the goal. A wedge that looks up or down is
    shorter. Where the robot stands, the view with which it continues is drawn.

    tour  draws wedges also where the robot stands for a while, as at the stops of a tour; if there is such a place and
          the camera always looks ahead, the wedges along the path are left out
    """
    if "base" not in trajectory.model.provides:
        draw_cones(axes, trajectory, colour, view, from_above, zorder=zorder, gid=gid)
        return
    reach = REACH * max(view.width, view.height)
    times = trajectory.times[:-1][is_held(trajectory)] if tour else np.zeros(0)
    if not times.size or turns_away(trajectory.model, [trajectory]):
        times = np.append(_moments(trajectory, APART * reach), times)
    pose = trajectory.model.pose("camera", trajectory.at(times))
    half = math.degrees(0.5 * _width(trajectory.model))
    wedges = [
        Wedge((x, y), reach * abs(math.cos(pitch)), math.degrees(yaw) - half, math.degrees(yaw) + half)
        for x, y, yaw, pitch in zip(pose.x, pose.y, pose.yaw, pose.pitch, strict=True)
    ]
    drawn = PatchCollection(wedges, **_look(colour))
    drawn.set(zorder=zorder, gid=gid)
    axes.add_collection(drawn, autolim=False)


def draw_cones(
    axes: Axes, trajectory: Trajectory, colour: str, view: View, flatten: Flatten, *, zorder: float, gid: str
) -> None:
    """Draw short view cones of the camera at even distances along the path, in a picture seen from above or the side.

    flatten : projects points in space (..., 3) to the picture (..., 2)
    """
    reach = CONE_REACH * max(view.width, view.height)
    pose = trajectory.model.pose("camera", trajectory.at(_moments(trajectory, CONES_APART * reach)))
    points = flatten(cone_points(trajectory.model, pose, reach))  # (N, 1 + K, 2)
    outlines = [shapely.get_coordinates(hull) for hull in shapely.convex_hull(shapely.multipoints(list(points)))]
    axes.add_collection(PolyCollection(outlines, zorder=zorder, gid=gid, **_look(colour)), autolim=False)
    rays = LineCollection(list(points[:, [0, AHEAD]]), colors=colour, linewidths=1.0, zorder=zorder + 0.05)
    axes.add_collection(rays, autolim=False)


def cone_points(model: Model, pose: Pose, reach: float) -> FloatArray:
    """Return the corners (N, 1 + K, 3), m, of N view cones: the camera, then K points at the distance ``reach``, m.

    An angle of view of half a turn or more is drawn as a narrow one, ahead.
    """
    h, v = (angle if angle < math.pi else POINTER for angle in field_of_view(model))
    b, e = (grid.ravel() for grid in np.meshgrid(0.5 * h * RIM, 0.5 * v * RIM))
    level = np.cos(e)
    axes = (np.stack(np.broadcast_arrays(*vector, pose.x)[:3], axis=1) for vector in (pose.ahead, pose.left, pose.up))
    shares = (level * np.cos(b), level * np.sin(b), np.sin(e))  # (K,) each
    rays = sum(share[:, None] * axis[:, None, :] for share, axis in zip(shares, axes, strict=True))  # (N, K, 3)
    camera = positions(pose)[:, None, :]
    return np.concatenate([camera, camera + reach * rays], axis=1)


def sight_entry(model: Model, *, cones: bool) -> Patch:
    """Return the legend entry for the wedges, or for the cones, of the camera's view."""
    given = model.field_of_view
    width, height = ("", "") if given is None else (f"{math.degrees(angle):.0f}°" for angle in given)
    said = f",\n{width} wide and {height} high" if cones else f", {width} wide"
    return Patch(**_look(QUIET), label="where the camera looks" + said * (given is not None))


def _look(colour: str) -> dict[str, Any]:
    return {"facecolor": (colour, 0.22), "edgecolor": (colour, 0.8), "linewidth": 0.5}


def _width(model: Model) -> float:
    """Return the angle of the wedge that shows the camera's view, rad; a small one if the view is all round."""
    given = model.field_of_view
    return POINTER if given is None or given[0] >= 2.0 * math.pi else float(given[0])


def _moments(trajectory: Trajectory, apart: float) -> FloatArray:
    """Return times (N,), s, that divide the camera's path into equal lengths of about ``apart`` m, with both ends.

    Where the camera stands still, the last such time is taken.
    """
    times = np.linspace(0.0, trajectory.duration, SAMPLES)
    steps = np.diff(positions(trajectory.model.pose("camera", trajectory.at(times))), axis=0)
    gone = np.append(0.0, np.cumsum(np.sqrt((steps**2).sum(axis=1))))
    number = max(1, round(float(gone[-1]) / apart))
    at = np.searchsorted(gone, np.linspace(0.0, gone[-1], number + 1)[:-1], side="right")
    return np.append(times[np.minimum(at, SAMPLES - 1)], trajectory.duration)


STEP = 15  # degrees
MINUS = "\N{MINUS SIGN}"


@dataclass(frozen=True)
class Section:
    """Vertical plane onto which a view from the side is projected.

    degrees  direction of the plane, counter-clockwise from x: a multiple of 15, above -90 and up to 90
    """

    degrees: int

    @classmethod
    def along(cls, paths: Sequence[FloatArray]) -> Section:
        """Return the plane along the direction in which paths (N, 3), m, spread most; along x if they do not spread."""
        pieces = np.concatenate([np.stack([path[:-1, :2], path[1:, :2]], axis=1) for path in paths])  # (n, 2, 2)
        middle = pieces.mean(axis=1)
        weight = np.hypot(*(pieces[:, 1] - pieces[:, 0]).T)
        if not weight.sum() > 0.0:
            return cls(0)
        off = middle - np.average(middle, axis=0, weights=weight)
        spread = np.einsum("n,ni,nj->ij", weight, off, off)
        yaw = 0.5 * math.atan2(2.0 * spread[0, 1], spread[0, 0] - spread[1, 1])
        degrees = STEP * round(math.degrees(yaw) / STEP)
        return cls(90 if degrees == -90 else degrees)

    @property
    def direction(self) -> FloatArray:
        """Return the unit vector (2,) along the plane, in the map."""
        yaw = math.radians(self.degrees)
        return np.array([math.cos(yaw), math.sin(yaw)])

    @property
    def label(self) -> str:
        """Return the label of the horizontal axis: x or y of the map, or a combination.

        >>> Section(0).label, Section(90).label, Section(-30).label
        ('x (m)', 'y (m)', 'along −30°: x cos 30° − y sin 30° (m)')
        """
        if self.degrees in (0, 90):
            return "y (m)" if self.degrees else "x (m)"
        angle, sign = f"{abs(self.degrees)}°", "+" if self.degrees > 0 else MINUS
        return f"along {sign.strip('+')}{angle}: x cos {angle} {sign} y sin {angle} (m)"

    def flattened(self, points: FloatArray) -> FloatArray:
        """Project points in space (..., 3), m, to the picture (..., 2): position along the plane, and height."""
        return np.stack([points[..., :2] @ self.direction, points[..., 2]], axis=-1)


OBSTACLE_LOOK: dict[str, Any] = {"facecolor": ("#d8cfbf", 0.45), "edgecolor": "#9c9078", "linewidth": 0.7}
BESIDE_SHARE = 0.1  # width of the zone beside the paths' hull, as a share of their longer side
LEAST_ASIDE = 0.4  # m
ENDLESS = 1e5  # m: drawn height of unlimited obstacles


@dataclass(frozen=True)
class PathSurroundings:
    """Area round some paths, which decides which obstacles a view from the side shows.

    among    convex hull of the paths, seen from above
    beside   the hull, grown by a border
    heights  range of the paths' heights
    """

    among: BaseGeometry
    beside: BaseGeometry
    heights: Heights

    @classmethod
    def of(cls, paths: Sequence[FloatArray]) -> PathSurroundings:
        """Return the area round paths (N, 3), m."""
        points = np.concatenate(paths)
        hull = shapely.convex_hull(shapely.MultiPoint(points[:, :2]))
        x0, y0, x1, y1 = hull.bounds
        beside = hull.buffer(max(BESIDE_SHARE * max(x1 - x0, y1 - y0), LEAST_ASIDE))
        return cls(hull, beside, Heights(float(points[:, 2].min()), float(points[:, 2].max())))

    def silhouettes(self, world: World, section: Section) -> list[Polygon]:
        """Return the outlines, m, of obstacles near the paths, projected to the plane of a side view.

        Prisms and cells beside the paths that span all heights of the paths, such as walls of a room, are left out,
        because they would hide everything.
        """
        solids = (solid for solid in world.ground.solids if solid.outline.intersects(self.beside))
        found = [solid_outline(solid, section.flattened) for solid in solids]
        for geometry, low, high in _prisms(world):
            at_all = low <= self.heights.low and self.heights.high <= high
            for part in shapely.get_parts(shapely.intersection(geometry, self.among if at_all else self.beside)):
                if part.area > 0.0:
                    along = shapely.get_coordinates(part) @ section.direction
                    found.append(shapely.box(along.min(), max(low, -ENDLESS), along.max(), min(high, ENDLESS)))
        return found


def draw_map_obstacles(axes: Axes, problem: Problem, heights: Heights, view: View) -> list[Patch]:
    """Draw obstacles on a map, shaded by the camera's heights if the robot has a base; return the legend entries."""
    world = problem.world
    if "base" in problem.model.provides:
        return draw_obstacles(axes, world, heights, view)
    solid = [*(obstacle.polygon for obstacle in world.obstacles), world.ground.raster_solid()]
    outlines = [outline(geometry) for geometry in solid if not geometry.is_empty]
    axes.add_collection(PathCollection(outlines, zorder=1.0, gid="silhouettes", **OBSTACLE_LOOK), autolim=False)
    return [Patch(**OBSTACLE_LOOK, label="obstacle of any height")]


BESIDE = "obstacle among the paths or beside\nthem, in front of them or behind"


def draw_silhouettes(axes: Axes, found: Sequence[Polygon], view: View, label: str = BESIDE) -> list[Patch]:
    """Draw outlines of obstacles lightly, since they may be before or behind the paths; return the legend entry."""
    shown = shapely.box(view.x_min - 1.0, view.y_min - 1.0, view.x_max + 1.0, view.y_max + 1.0)
    outlines = [shapely.get_coordinates(shapely.intersection(shown, one)) for one in found if shown.intersects(one)]
    if not outlines:
        return []
    axes.add_collection(PolyCollection(outlines, zorder=1.0, gid="silhouettes", **OBSTACLE_LOOK), autolim=False)
    return [Patch(**OBSTACLE_LOOK, label=label)]


def ends_of(found: Sequence[Polygon]) -> Heights:
    """Return the lowest and highest end of some outlines, m, leaving out unlimited ends; (inf, -inf) for none."""
    ends = np.array([(one.bounds[1], one.bounds[3]) for one in found]).reshape(-1, 2)
    lows, highs = (side[np.abs(side) < ENDLESS] for side in ends.T)
    return Heights(float(lows.min(initial=np.inf)), float(highs.max(initial=-np.inf)))


def _prisms(world: World) -> Iterator[tuple[BaseGeometry, float, float]]:
    """Yield the outline, bottom and top, m, of each obstacle that is an upright prism, and of the raster's cells."""
    for obstacle in world.obstacles:
        if obstacle.solid is None:
            yield obstacle.polygon, *obstacle.heights
    if world.raster is not None:
        yield world.ground.raster_solid(), *world.raster.heights
