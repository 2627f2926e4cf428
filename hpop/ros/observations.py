"""Observations from ROS messages: transforms, occupancy grids, filter masks, and people around the robot.

Messages are dictionaries, as rosbridge sends them. None is trusted: a :class:`RosError` names a wrong field.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from hpop.base.options import FARTHEST
from hpop.base.text import is_whole, shown
from hpop.errors import MapError, RosError
from hpop.ros.messages import SECOND, PlanarPose, mapping, number, planar_pose, text, time_of, yaw_of
from hpop.world import Person, World
from hpop.world.content.content import Zone
from hpop.world.geometry.shapes import Raster

MOST_FRAMES, MOST_PEOPLE, MOST_CELLS = 1000, 200, 2**24
LETHAL = 100  # value of a keep-out mask that closes a cell, in percent
OCCUPIED = 65  # percent from which a cell of a map is an obstacle, as in map_saver
FASTEST = 10.0  # m/s of a person
STANDING = 0.05  # m/s up to which a person is taken to stand
SAME_PERSON = 1.0  # m that a person without a name may move between two messages
DRIFT = 1e-3  # s/s by which two clocks may drift apart


class MessageAge:
    """Age of messages of one sender, whose clock may differ from the receiver's by any constant.

    The message with the least difference between arrival and stamp counts as one that came without delay.
    """

    def __init__(self) -> None:
        self._offset, self._at = math.inf, 0.0

    def of(self, now: float, stamp: int) -> float:
        """Return the age, s, of a message that arrives at ``now``, s; ``stamp`` is in ns, and the age 0 if it is 0."""
        if not stamp:
            return 0.0
        offset = now - stamp / SECOND
        self._offset, self._at = min(self._offset + DRIFT * max(0.0, now - self._at), offset), now
        return offset - self._offset


class _Link(NamedTuple):
    """Transform from a frame to its parent: x m, y m, yaw rad; its time is infinite if it never changes."""

    parent: str
    x: float
    y: float
    yaw: float
    at: float  # s


class Transforms:
    """Tree of transforms between frames, as tf publishes them; only x, y and yaw are kept."""

    def __init__(self) -> None:
        self._links: dict[str, _Link] = {}
        self._ages: dict[str, MessageAge] = {}

    def hear(self, message: Any, now: float, *, static: bool = False) -> None:
        """Store the transforms of a tf2_msgs/TFMessage that came at ``now``, s.

        Transforms without a heading, such as to the optical frame of a camera, are left out.
        """
        transforms = mapping(message, "a tf message").get("transforms")
        if not isinstance(transforms, Sequence) or isinstance(transforms, str):
            raise RosError(f"a tf message must have a list of transforms, got {shown(transforms)}")
        for one in transforms:
            told = mapping(one, "a transform")
            child = text(told.get("child_frame_id"), "child_frame_id of a transform").strip("/")
            where = f"the transform of {child}"
            head = mapping(told.get("header"), f"header of {where}")
            parent = text(head.get("frame_id"), f"frame_id of {where}").strip("/")
            moved = mapping(told.get("transform"), where)
            place = mapping(moved.get("translation"), f"translation of {where}")
            x, y = (number(place.get(axis), f"translation.{axis} of {where}", FARTHEST) for axis in "xy")
            try:
                yaw = yaw_of(moved.get("rotation"), where)
            except RosError:
                if not _is_rotation(moved.get("rotation")):
                    raise
                continue
            if child not in self._links and len(self._links) >= MOST_FRAMES:
                raise RosError(f"tf has more than {MOST_FRAMES:,} frames; publish fewer on this bridge")
            age = 0.0 if static else self._ages.setdefault(child, MessageAge()).of(now, time_of(told, where))
            self._links[child] = _Link(parent, x, y, yaw, math.inf if static else now - age)

    def forget_moving(self) -> None:
        """Forget all transforms that are not static, and the ages of messages."""
        self._links = {child: link for child, link in self._links.items() if link.at == math.inf}
        self._ages = {}

    def pose(self, frame: str, child: str) -> tuple[PlanarPose, float] | None:
        """Return the pose of the frame ``child`` in ``frame``, and the time, s, of the oldest transform between them.

        The time is infinite if all are static. None if they are not connected. RosError if it is no text.
        """
        x = y = yaw = 0.0
        oldest, name = math.inf, text(child, "the name of a frame")
        for _ in range(len(self._links) + 1):
            if name == frame:
                return PlanarPose(x, y, math.remainder(yaw, math.tau), frame), oldest
            link = self._links.get(name)
            if link is None:
                return None
            x, y = _placed(link, x, y)
            yaw, oldest, name = yaw + link.yaw, min(oldest, link.at), link.parent
        return None  # a loop


def _is_rotation(told: Any) -> bool:
    """Return whether a message is a quaternion of numbers, which then only lacks a heading."""
    values = [told.get(axis) for axis in "xyzw"] if isinstance(told, Mapping) else [None]
    numbers = [value for value in values if isinstance(value, int | float)]
    return len(numbers) == 4 and abs(math.hypot(*numbers) - 1.0) < 0.1


def _placed(pose: _Link | PlanarPose, x: float, y: float) -> tuple[float, float]:
    """Transform a point (x, y), m, from a frame to its parent frame, in which ``pose`` is the pose of the frame."""
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    return pose.x + cos * x - sin * y, pose.y + sin * x + cos * y


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """Occupancy grid: percent (H, W), or -1 for unknown cells; row 0 at the bottom.

    resolution  m, width of a cell
    origin      (x m, y m, yaw rad) of the lower left corner
    """

    cells: NDArray[np.int8]
    resolution: float
    origin: tuple[float, float, float]

    @classmethod
    def of(cls, message: Any, frame: str) -> OccupancyGrid:
        """Read a nav_msgs/OccupancyGrid, which must be in the frame ``frame``."""
        told = mapping(message, "a map")
        _check_frame(told, frame, "a map")
        info = mapping(told.get("info"), "info of a map")
        width, height = (_size(info.get(name), f"{name} of a map") for name in ("width", "height"))
        resolution = number(info.get("resolution"), "resolution of a map", FARTHEST)
        if not resolution >= 1e-3:
            raise RosError(f"resolution of a map must be at least 0.001 m, got {resolution:g}")
        origin = planar_pose({"pose": info.get("origin")}, "origin of a map")
        cells = _cells(told.get("data"), width, height, "a map")
        return cls(cells, float(f"{resolution:.7g}"), origin[:3])  # of a float32

    def updated(self, message: Any) -> OccupancyGrid:
        """Return the grid with the cells of a map_msgs/OccupancyGridUpdate; this grid is unchanged."""
        told = mapping(message, "a map update")
        x, y = (_size(told.get(name), f"{name} of a map update", least=0) for name in "xy")
        width, height = (_size(told.get(name), f"{name} of a map update") for name in ("width", "height"))
        rows, columns = self.cells.shape
        if y + height > rows or x + width > columns:
            raise RosError(f"a map update reaches beyond the map of {columns} x {rows} cells; publish the map again")
        cells = self.cells.copy()
        cells[y : y + height, x : x + width] = _cells(told.get("data"), width, height, "a map update")
        return replace(self, cells=cells)

    def area(self, chosen: NDArray[np.bool_]) -> BaseGeometry:
        """Return the area, m, of chosen cells (H, W); RosError if it has too many corners."""
        try:
            return Raster(chosen, self.resolution, self.origin).solid()
        except MapError as error:
            raise RosError(f"the grid cannot be used: {error}") from None

    def centres(self, chosen: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return x and y (n,), m, of the centres of chosen cells (H, W)."""
        rows, columns = np.nonzero(chosen)
        return Raster(chosen, self.resolution, self.origin).to_world(columns + 0.5, rows + 0.5)

    def value_at(self, x: float, y: float) -> int:
        """Return the value of the cell at a position, m; -1 beyond the grid."""
        dx, dy, (_, _, yaw) = x - self.origin[0], y - self.origin[1], self.origin
        ahead, left = math.cos(yaw) * dx + math.sin(yaw) * dy, math.cos(yaw) * dy - math.sin(yaw) * dx
        column, row = math.floor(ahead / self.resolution), math.floor(left / self.resolution)
        rows, columns = self.cells.shape
        return int(self.cells[row, column]) if 0 <= row < rows and 0 <= column < columns else -1


def _size(value: Any, where: str, least: int = 1) -> int:
    if not is_whole(value) or not least <= value <= MOST_CELLS:
        raise RosError(f"{where} must be a whole number from {least} to {MOST_CELLS:,}, got {shown(value)}")
    return int(value)


def _cells(data: Any, width: int, height: int, where: str) -> NDArray[np.int8]:
    if width * height > MOST_CELLS:
        raise RosError(f"{where} must have at most {MOST_CELLS:,} cells, got {width} x {height}")
    try:
        values = np.asarray(data)
    except (TypeError, ValueError, OverflowError):
        values = np.empty(0)
    if values.ndim != 1 or values.size != width * height or values.dtype.kind not in "iu":
        got = f"{values.size:,}" if values.dtype.kind in "iu" else "other values"
        raise RosError(f"data of {where} must be {width * height:,} whole numbers (width x height), got {got}")
    if values.min() < -1 or values.max() > 100:
        raise RosError(f"data of {where} must be from -1 to 100 percent, got {values.min()} to {values.max()}")
    return values.astype(np.int8).reshape(height, width)


def _check_frame(message: Mapping[str, Any], frame: str, where: str) -> None:
    got = text(mapping(message.get("header", {}), f"header of {where}").get("frame_id", ""), f"frame_id of {where}")
    if got.strip("/") != frame:
        raise RosError(f"{where} must be in the frame {frame}, got {shown(got)}; publish it in that frame")


@dataclass(frozen=True)
class FilterScale:
    """Meaning of the cells in the mask of a costmap filter: base + multiplier times the cell's value.

    kind  0: keep-out, closed from 100; 1: speed limit in percent of the cruise speed; 2: speed limit in m/s
    """

    kind: int = 0
    base: float = 0.0
    multiplier: float = 1.0

    @classmethod
    def of(cls, message: Any) -> FilterScale:
        """Read a nav2_msgs/CostmapFilterInfo."""
        told = mapping(message, "a filter info")
        kind = told.get("type")
        if not is_whole(kind) or kind not in (0, 1, 2):
            raise RosError(f"type of a filter info must be 0 (keep-out), 1 or 2 (speed limits), got {shown(kind)}")
        base, multiplier = (number(told.get(key), f"{key} of a filter info", 1e6) for key in ("base", "multiplier"))
        return cls(int(kind), base, multiplier)

    def speed(self, value: int, cruise: float) -> float:
        """Return the speed limit, m/s, of a cell's value; infinite for none. ``cruise`` is the robot's speed, m/s."""
        limit = self.base + self.multiplier * value
        if self.kind == 0 or value <= 0 or not limit > 0:
            return math.inf
        return limit if self.kind == 2 else 0.01 * limit * cruise


def with_grid(world: World, grid: OccupancyGrid | None, mask: OccupancyGrid | None) -> World:
    """Return a scenario's world as a map and a keep-out mask show it.

    A world of cells takes its cells from the map. In a world of polygons, which may have heights, occupied cells
    farther than a cell from its obstacles are closed to the robot; what the map shows as free stays as it is. In both,
    cells of the mask from `LETHAL` percent are closed.
    """
    content = world.content
    if grid is not None and world.raster is not None and not world.obstacles:
        world = _of_cells(world, grid)
        grid = None
    closed = new_areas(world, grid, mask)
    zones = [*content.zones, *(Zone("keep-out", area) for area in closed)]
    return world.with_content(people=content.people, groups=content.groups, landmarks=content.landmarks, zones=zones)


def new_areas(world: World, grid: OccupancyGrid | None, mask: OccupancyGrid | None) -> list[BaseGeometry]:
    """Return the areas, m, of the cells of a map and a keep-out mask that are occupied or closed.

    Cells of the map that are at most a cell from an obstacle of ``world`` are left out.
    """
    areas = []
    if grid is not None:
        new = grid.cells >= OCCUPIED
        new[new] = world.clearance(*grid.centres(new)) > grid.resolution
        areas += [grid.area(new)] if new.any() else []
    if mask is not None and (lethal := mask.cells >= LETHAL).any():
        areas.append(mask.area(lethal))
    return areas


def _of_cells(world: World, grid: OccupancyGrid) -> World:
    """Return a world with the cells of a grid; if the grids match, values derived from equal cells are kept."""
    before = world.raster
    assert before is not None
    same = before.cells.shape == grid.cells.shape and np.allclose(
        (before.resolution, *before.origin), (grid.resolution, *grid.origin), rtol=0.0, atol=1e-6
    )
    try:
        if same:
            return world.updated(grid.cells)
        return World.from_occupancy_grid(
            grid.cells,
            grid.resolution,
            grid.origin,
            unknown_is_free=not world.ground.outside_is_obstacle,
            height=before.heights,
            keep_out=world.keep_out,
        )
    except MapError as error:
        raise RosError(f"the map cannot be used: {error}") from None


class PeopleSeen:
    """People around the robot, from people_msgs/People, or geometry_msgs/PoseArray, whose indices are their ids."""

    def __init__(self, radius: float = 0.25) -> None:
        self.radius = radius
        self._before: tuple[float, dict[str, tuple[float, float]]] = (-math.inf, {})

    def heard(self, message: Any, frame: str, transforms: Transforms, now: float) -> tuple[Person, ...]:
        """Return the people of a message in the frame ``frame``, with the velocities at which they walk on.

        A PoseArray has no velocities: they follow from the positions of the message before, by index.
        """
        told = mapping(message, "a people message")
        head = mapping(told.get("header", {}), "header of a people message")
        given = text(head.get("frame_id", ""), "frame_id of a people message").strip("/")
        found = (PlanarPose(0.0, 0.0, 0.0, frame), now) if given == frame else transforms.pose(frame, given)
        if found is None:
            raise RosError(f"people in the frame {shown(given)}, of which tf knows no place in {frame}; publish it")
        rows = told.get("people", told.get("poses"))
        if not isinstance(rows, Sequence) or isinstance(rows, str) or len(rows) > MOST_PEOPLE:
            raise RosError(f"a people message must have a list of at most {MOST_PEOPLE} people, got {shown(rows)}")
        seen = [_person_row(row, f"person {i}", str(i)) for i, row in enumerate(rows)]
        places = {name: _placed(found[0], x, y) for name, x, y, _ in seen}
        when, before = self._before
        people = []
        for name, _, _, told_velocity in seen:
            x, y = places[name]
            if told_velocity is None:
                velocity = _velocity((x, y), before.get(name), now - when)
            else:
                vx, vy = _placed(found[0]._replace(x=0.0, y=0.0), *told_velocity)
                velocity = (vx, vy) if math.hypot(vx, vy) > STANDING else (0.0, 0.0)
            people.append(Person(x, y, velocity=velocity, radius=self.radius, name=name))
        self._before = now, places
        return tuple(people)


def _person_row(row: Any, where: str, index: str) -> tuple[str, float, float, tuple[float, float] | None]:
    """Return name, x, y, and the velocity if the row has one, of a person or a pose."""
    told = mapping(row, where)
    place = mapping(told.get("position"), f"position of {where}")
    x, y = (number(place.get(axis), f"position.{axis} of {where}", FARTHEST) for axis in "xy")
    if "velocity" not in told:
        return index, x, y, None
    moves = mapping(told["velocity"], f"velocity of {where}")
    vx, vy = (number(moves.get(axis), f"velocity.{axis} of {where}", FASTEST) for axis in "xy")
    return text(told.get("name", ""), f"name of {where}") or index, x, y, (vx, vy)


def _velocity(here: tuple[float, float], before: tuple[float, float] | None, seconds: float) -> tuple[float, float]:
    """Return the velocity, m/s, between two positions, m; 0 for a new person, after over 2 s, and for a jump."""
    if before is None or not 1e-3 < seconds < 2.0 or math.dist(here, before) > SAME_PERSON:
        return 0.0, 0.0
    vx, vy = ((now - then) / seconds for now, then in zip(here, before, strict=True))
    return (vx, vy) if STANDING < math.hypot(vx, vy) <= FASTEST else (0.0, 0.0)
