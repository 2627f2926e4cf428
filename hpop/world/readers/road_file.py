"""Elements of a road file in CommonRoad XML, checked: numbers, shapes, states and lanes.

The format is read without the library commonroad-io, which needs one old version of protobuf and parses with entities.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from shapely.affinity import rotate, translate
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import FloatArray
from hpop.base.options import FARTHEST
from hpop.base.text import printable, shown
from hpop.base.xml import parsed_xml
from hpop.errors import MapError
from hpop.runtime import limits
from hpop.runtime.limits import READING
from hpop.world.files import named, read_bytes

MOST_BYTES = 50_000_000
"""Size of the largest road file, bytes: some ten seconds of reading."""
MOST_ELEMENTS = 2_000_000
PARSED = 20
"""Memory of the elements of a file per byte while it is read, bytes."""
VERSIONS = ("2018b", "2020a")
FASTEST = 100.0
"""Largest speed limit, m/s; a greater number is in km/h."""
SPEED_SIGNS = frozenset({"274", "274.1", "R2-1", "r301", "3.24", "R15", "C43", "B14", "B31", "Ρ-32"})
"""Traffic signs that set a largest speed, of the countries that CommonRoad knows; their value is in m/s."""
NO_CARS = frozenset({"sidewalk", "crosswalk", "bicycleLane"})
"""Types of lanes that are no part of the road; a crosswalk lies on lanes that are."""
ON_FOOT = frozenset({"pedestrian", "bicycle"})
CONVERT = {
    "OpenDRIVE": "it is OpenDRIVE: convert it to CommonRoad, such as by crdesigner (pip install "
    "commonroad-scenario-designer): crdesigner --input-file map.xodr --output-file road.xml odrcr",
    "osm": "it is OpenStreetMap or lanelet2: convert it to CommonRoad, such as by crdesigner (pip install "
    "commonroad-scenario-designer): crdesigner --input-file map.osm --output-file road.xml lanelet2cr",
    "CommonRoadSolution": "it is a solution, not a scenario: give the scenario's file",
}
"""What to do with other files, by their outermost element."""
TINY = 1e-12  # smaller numbers are errors of rounding, and count as 0
SAME = 1e-6  # m: nearer points of a line count as one
CORNERS = 8  # segments of a quarter of a circle; polygons contain their circles


class Shape(NamedTuple):
    """Shape of an obstacle or a goal, m, in the frame of its owner.

    area    polygon
    radius  of a circle about ``middle``; None for other shapes
    """

    area: Polygon
    middle: tuple[float, float]
    radius: float | None


class RoadState(NamedTuple):
    """State of an obstacle or a car: time, s; x and y, m; yaw, rad (NaN if it is not stated).

    blur   m    largest distance of the position from (x, y)
    swing  rad  largest difference of the heading from yaw
    """

    time: float
    x: float
    y: float
    yaw: float
    blur: float
    swing: float


@dataclass(frozen=True, eq=False)
class Lane:
    """Lane of a road: a lanelet.

    area     polygon, m
    middle   line midway between its bounds, m, in the direction of traffic; None if it has no length
    one_way  whether its traffic has one direction
    limit    m/s, largest speed; None if none is stated
    """

    number: str
    area: BaseGeometry
    middle: LineString | None
    one_way: bool
    limit: float | None

    def heading(self, at: float) -> float:
        """Return the direction of traffic, rad, at a distance along the middle line, m."""
        assert self.middle is not None
        ends = [max(at - 0.1, 0.0), min(at + 0.1, self.middle.length)]
        (ax, ay), (bx, by) = (self.middle.interpolate(end).coords[0] for end in ends)
        return math.atan2(by - ay, bx - ax)


@dataclass(frozen=True, eq=False)
class RoadFile:
    """Road file that was read; its methods check elements and raise errors that name the file.

    step   s, time between two steps
    notes  lanes that were left out or repaired; filled while they are read
    """

    path: str | Path
    data: bytes
    root: Element
    step: float
    notes: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, path: str | Path) -> RoadFile:
        """Read and parse a file; raise MapError unless it is CommonRoad XML of a known version."""
        data = read_bytes(path, "road file", limit=MOST_BYTES)
        limits.hold(READING, len(data), PARSED * len(data))

        def error(said: str) -> MapError:
            return MapError(f"road file {named(path)}: {said}.")

        root = parsed_xml(data, error, MOST_ELEMENTS, "cut the file to the part that is needed")
        if root.tag != "commonRoad":
            raise error(
                CONVERT.get(root.tag)
                or f"its outermost element must be <commonRoad>, got <{printable(root.tag)[:80]}>; give a scenario of "
                "CommonRoad, in XML"
            )
        version = root.get("commonRoadVersion")
        if version not in VERSIONS:
            raise error(
                f"its version must be {' or '.join(VERSIONS)}, got {shown(version)}; save it in one of these, such as "
                "by commonroad-io (CommonRoadFileReader, CommonRoadFileWriter)"
            )
        file = cls(path, data, root, 1.0)
        return cls(path, data, root, file._value("its timeStepSize", root.get("timeStepSize"), 1e-4, 1e3))

    def error(self, said: str) -> MapError:
        """Return a MapError whose message names this file and continues with ``said``."""
        return MapError(f"road file {named(self.path)}: {said}.")

    def number(self, owner: Element, tag: str, what: str) -> float:
        """Return the number in the child ``tag`` of an element; ``what`` names the element in a MapError."""
        return self._value(f"<{tag}> of {what}", owner.findtext(tag))

    def span(self, owner: Element, tag: str, what: str) -> tuple[float, float] | None:
        """Return the interval that a child of an element states, of no length if it is exact; None without a child."""
        child = owner.find(tag)
        if child is None:
            return None
        whole = f"<{tag}> of {what}"
        if child.find("exact") is not None:
            exact = self.number(child, "exact", whole)
            return exact, exact
        low, high = (self.number(child, name, whole) for name in ("intervalStart", "intervalEnd"))
        if low > high:
            raise self.error(f"{whole} begins at {low:g} and ends at {high:g}; exchange them")
        return low, high

    def points(self, owner: Element | None, what: str) -> FloatArray:
        """Return the points (N, 2), m, of an element."""
        found = [] if owner is None else owner.findall("point")
        rows = [(self.number(point, "x", what), self.number(point, "y", what)) for point in found]
        return np.array(rows).reshape(-1, 2)

    def shapes(self, owner: Element, what: str) -> list[Shape]:
        """Return the rectangles, circles and polygons in an element."""
        found = []
        for given in owner:
            limits.check(READING)
            centre = given.find("center")
            x, y = (0.0, 0.0) if centre is None else (self.number(centre, axis, what) for axis in "xy")
            if given.tag == "rectangle":
                length, width = (self._size(given, name, what) for name in ("length", "width"))
                turned = 0.0 if given.find("orientation") is None else self.number(given, "orientation", what)
                box = shapely.box(-length / 2, -width / 2, length / 2, width / 2)
                area = translate(rotate(box, turned, origin=(0, 0), use_radians=True), x, y)
                found.append(Shape(area, (x, y), None))
            elif given.tag == "circle":
                radius = self._size(given, "radius", what)
                found.append(Shape(_disc(x, y, radius), (x, y), radius))
            elif given.tag == "polygon":
                points = self.points(given, what)
                area = Polygon(points) if len(points) > 2 else Polygon()
                if not (area.is_valid and area.area > 0):
                    raise self.error(f"a polygon of {what} must have three or more corners and an area; correct it")
                found.append(Shape(area, (area.centroid.x, area.centroid.y), None))
        return found

    def state(self, given: Element, what: str) -> RoadState:
        """Return the state in an element; a position or heading within bounds is their middle, with a blur or swing."""
        time = self.span(given, "time", what)
        if time is None or time[0] != time[1]:
            raise self.error(f"the <time> of {what} must be exact; state its step as <exact>")
        position = given.find("position")
        points = self.points(position, what)
        blur = 0.0
        if len(points) == 1:
            x, y = points[0].tolist()
        else:
            shapes = [] if position is None else self.shapes(position, what)
            if len(shapes) != 1:
                raise self.error(f"the <position> of {what} must be a point or one shape; give a point")
            x, y = shapes[0].middle
            blur = float(np.hypot(*(shapely.get_coordinates(shapes[0].area) - (x, y)).T).max())
        low, high = self.span(given, "orientation", what) or (math.nan, math.nan)
        swing = 0.0 if math.isnan(low) else min((high - low) / 2, math.pi)
        return RoadState(time[0] * self.step, x, y, (low + high) / 2, blur, swing)

    def lanes(self) -> list[Lane]:
        """Return the lanes on which cars may drive; raise MapError if there is none."""
        signs = {sign.get("id"): self._limit_of_sign(sign) for sign in self.root.findall("trafficSign")}
        lanes, left_out, repaired, unknown = list[Lane](), 0, list[str](), list[str]()
        for lanelet in self.root.findall("lanelet"):
            limits.check(READING)
            number = printable(lanelet.get("id", "?"))[:20]
            users = {user.text for tag in ("userOneWay", "userBidirectional") for user in lanelet.findall(tag)}
            kinds = {kind.text for kind in lanelet.findall("laneletType")}
            if kinds & NO_CARS or (users and users <= ON_FOOT):
                left_out += 1
                continue
            what = f"lanelet {number}"
            sides = [self.points(lanelet.find(side), what) for side in ("leftBound", "rightBound")]
            if min(map(len, sides)) < 2:
                raise self.error(f"{what} must have two bounds of at least two points; add them, or remove it")
            area: BaseGeometry = Polygon(np.concatenate([sides[0], sides[1][::-1]]))
            if not area.is_valid:
                area = shapely.union_all(list(polygons_of(shapely.make_valid(area))))
                repaired.append(number)
            if area.is_empty:
                raise self.error(f"{what} has no area; correct its bounds, or remove it")
            refs = [ref.get("ref") for ref in lanelet.findall("trafficSignRef")]
            unknown += [f"{ref}" for ref in refs if ref not in signs]
            stated = [signs[ref] for ref in refs if ref in signs]
            if lanelet.find("speedLimit") is not None:
                stated.append(self._limit(lanelet.findtext("speedLimit"), what))
            limit = min((one for one in stated if one is not None), default=None)
            one_way = lanelet.find("userBidirectional") is None
            lanes.append(Lane(number, area, _middle(*sides), one_way, limit))
        if not lanes:
            raise self.error("it must have a <lanelet> for cars, but has none; give a scenario with a road")
        for count, said in (
            (left_out, f"{left_out} lanes for pedestrians or bicycles are no part of the road"),
            (len(repaired), f"bounds cross in lanelets {', '.join(repaired[:5])}; the area between them is the lane"),
            (len(unknown), f"traffic signs {', '.join(unknown[:5])} are referred to, but not there"),
        ):
            self.notes.extend([f"{named(self.path)}: {said}"] if count else [])
        return lanes

    def _limit_of_sign(self, sign: Element) -> float | None:
        """Return the largest speed, m/s, that a traffic sign states; None if it states none."""
        found = [
            self._limit(element.findtext("additionalValue"), f"traffic sign {printable(sign.get('id', '?'))[:20]}")
            for element in sign.findall("trafficSignElement")
            if (element.findtext("trafficSignID") or "").strip() in SPEED_SIGNS
        ]
        return min((limit for limit in found if limit is not None), default=None)

    def _limit(self, given: str | None, what: str) -> float | None:
        """Return a speed limit, m/s; None for an infinite one."""
        if given is not None and given.strip().lower().lstrip("+") in ("inf", "infinity"):
            return None
        whole = f"the speed limit of {what}, in m/s (not km/h),"
        return self._value(whole, given, 1e-3, FASTEST)

    def _size(self, given: Element, tag: str, what: str) -> float:
        return self._value(f"<{tag}> of {what}", given.findtext(tag), 1e-6, 1e4)

    def _value(self, what: str, given: str | None, least: float = -FARTHEST, most: float = FARTHEST) -> float:
        """Return the number in a text; raise MapError unless it is from ``least`` to ``most``."""
        try:
            value = float(given or "")
        except ValueError:
            value = math.nan
        if not least <= value <= most:
            raise self.error(f"{what} must be a number from {least:g} to {most:g}, got {shown(given, 40)}; correct it")
        return value if abs(value) > TINY else 0.0


def _disc(x: float, y: float, radius: float) -> Polygon:
    """Return a regular polygon that contains a circle, m."""
    return shapely.Point(x, y).buffer(radius / math.cos(math.pi / (4 * CORNERS)), quad_segs=CORNERS)


def polygons_of(area: BaseGeometry) -> Iterator[Polygon]:
    """Yield the polygons among the parts of a geometry."""
    for part in shapely.get_parts(area):
        if isinstance(part, Polygon):
            yield part
        elif part.geom_type in ("MultiPolygon", "GeometryCollection"):
            yield from polygons_of(part)


def _middle(left: FloatArray, right: FloatArray) -> LineString | None:
    """Return the line midway between two bounds (N, 2) and (M, 2), m; None if it has no length."""
    shares = []
    for side in (left, right):
        length = np.append(0.0, np.cumsum(np.hypot(*np.diff(side, axis=0).T)))
        shares.append(length / max(length[-1], 1e-9))
    at = np.unique(np.concatenate(shares))
    pairs = zip(shares, (left, right), strict=True)
    sides = [[np.interp(at, share, side[:, axis]) for axis in (0, 1)] for share, side in pairs]
    points = (left + right) / 2 if len(left) == len(right) else np.mean(sides, axis=0).T
    points = points[np.append(True, np.hypot(*np.diff(points, axis=0).T) > SAME)]
    return LineString(points) if len(points) > 1 else None
