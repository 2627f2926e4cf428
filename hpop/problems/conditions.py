"""Conditions that a path shall satisfy: a place where it passes, in words or as a shape, and upper bounds of costs."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from shapely.geometry import LineString, MultiPolygon, Point, Polygon
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.options import real
from hpop.base.text import shown
from hpop.errors import OptionError, QueryError, UnknownName, did_you_mean
from hpop.planners.graphs.passing import Passage

if TYPE_CHECKING:
    from hpop.problems.front import Front
    from hpop.problems.problem import Problem
    from hpop.world import World

WITHIN = 0.5  # m: a path passes by a point if the base comes as near
FORMS = (
    '"left of NAME", "right of NAME", "between NAME and NAME", the name of a zone, a position x,y, two positions (a '
    "line), or three or more corners of a polygon, in m"
)
SAMPLES = 40  # along each axis of a region that is checked for free places
BESIDE = re.compile(r"(left|right) of (.+)", re.IGNORECASE)
BETWEEN = re.compile(r"between (.+)", re.IGNORECASE)
LESS = re.compile(r"(?:fewer|less)\s+(.+)", re.IGNORECASE)
HURRY = "hurry"
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?"
POSITION = re.compile(rf"({NUMBER})\s*,\s*({NUMBER})", re.IGNORECASE)
POSITIONS = re.compile(rf"{POSITION.pattern}(?:[\s;]+{POSITION.pattern})*", re.IGNORECASE)


def passage_of(problem: Problem, place: Any) -> Passage:
    """Return the passage that a place describes: words, a shape of shapely, or positions (x, y), m.

    Words are "left of NAME", "right of NAME", "between NAME and NAME", the name of a zone, or positions as "x,y".
    Left and right are those of a traveller from start to goal, along the straight line between them. A path passes left
    of an obstacle if it crosses, an odd number of times, the line that leaves the obstacle's leftmost point at a right
    angle to the left, up to the border of the map. "Between" is the shortest line between two obstacles.

    Raises QueryError for words that are not understood, for unknown names, and for a place off the map or wholly
    blocked.
    """
    world = problem.world
    if not {"x", "y"} <= set(problem.model.space.names):
        raise QueryError(f"a path passes somewhere only with a base in the plane, which {problem.model.name} lacks")
    if not isinstance(place, str):
        return _passage(world, _shape(place))
    text = place.strip()
    if POSITIONS.fullmatch(text):
        return _passage(world, _shape([(float(x), float(y)) for x, y in POSITION.findall(text)]))
    if match := BESIDE.fullmatch(text):
        side, name = match.group(1).lower(), match.group(2)
        return _beside(problem, side, _Named.of(world, name))
    if match := BETWEEN.fullmatch(text):
        return _between(world, match.group(1))
    zones, named = _zones(world), _named(world)
    if (zone := _meant(text, zones)) is not None:
        return _passage(world, zones[zone], f"through {_with_article(zone)}")
    thing = _meant(text, named)
    hint = _near(text, zones) if thing is None else f" {thing!r} is no zone: ask for left of it or right of it."
    raise QueryError(
        f"a place where a path passes must be {FORMS}; got {shown(place)}.{hint} Zones: {_listed(zones)}; things "
        f"with a left and a right: {_listed(named)}"
    )


def _listed(names: Iterable[str]) -> str:
    """Return names of things of the map as text: "'statue', 'bench'"; "none" without any."""
    return ", ".join(map(repr, names)) or "none"


def _shape(place: Any) -> BaseGeometry:
    """Return a point, line or polygon, from a shape of shapely or from positions (x, y), m."""
    shape: BaseGeometry = place
    if not isinstance(place, BaseGeometry):
        try:
            corners: FloatArray = np.atleast_2d(np.array(place, np.float64))
        except (TypeError, ValueError, OverflowError):
            corners = np.zeros((0, 2))
        if corners.ndim != 2 or corners.shape[1:] != (2,) or not len(corners) or not np.isfinite(corners).all():
            raise QueryError(f"a place where a path passes must be {FORMS}; got {shown(place)}")
        shape = (Point, LineString, Polygon)[min(len(corners), 3) - 1](corners if len(corners) > 1 else corners[0])
    if not np.isfinite(shapely.get_coordinates(shape)).all() or not shape.is_valid:
        reason = shapely.is_valid_reason(shape)
        raise QueryError(f"a place where a path passes must be a valid shape ({reason}); give its corners in order")
    is_line = isinstance(shape, LineString) and len(shape.coords) == 2
    if shape.is_empty or not (is_line or isinstance(shape, Polygon | MultiPolygon | Point)):
        raise QueryError(
            f"a place where a path passes must be a point, a line of two points, or a polygon; got {shown(place)}"
        )
    return shape


def _passage(world: World, shape: BaseGeometry, words: str = "") -> Passage:
    """Return the passage through a shape; QueryError if it is off the map or wholly blocked."""
    if isinstance(shape, LineString):
        ends = [f"({x:g}, {y:g})" for x, y in shape.coords]
        passage = Passage(words or f"between {' and '.join(ends)}", shape, across=True)
    elif isinstance(shape, Point):
        passage = Passage(words or f"within {WITHIN:g} m of ({shape.x:g}, {shape.y:g})", shape, WITHIN)
    else:
        middle = shape.centroid
        passage = Passage(words or f"through the region about ({middle.x:.4g}, {middle.y:.4g})", shape)
    x0, y0, x1, y1 = world.bounds
    what = words.removeprefix("through ") or {"Point": "the position", "LineString": "the line"}.get(
        shape.geom_type, "the region"
    )
    if shape.distance(shapely.box(x0, y0, x1, y1)) > passage.within:
        raise QueryError(
            f"{what} where a path shall pass is off the map, which spans x {x0:.2f} to {x1:.2f} m, y {y0:.2f} to "
            f"{y1:.2f} m; give a place on it"
        )
    x, y = _samples(passage)
    if not (world.clearance(x, y) > 0.0).any():
        raise QueryError(
            f"{what} where a path shall pass is wholly blocked: no free place was found there; to pass an obstacle on "
            "one side, ask for left of it or right of it"
        )
    return passage


def _samples(passage: Passage) -> tuple[FloatArray, FloatArray]:
    """Return positions (M,), m, in the region or on the line of a passage."""
    shape = passage.shape
    if passage.across:
        share, (begin, end) = np.linspace(0.0, 1.0, SAMPLES**2)[:, None], shapely.get_coordinates(shape)
        x, y = (begin + share * (end - begin)).T
        return x, y
    x0, y0, x1, y1 = shape.buffer(passage.within).bounds
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(x0, x1, SAMPLES), np.linspace(y0, y1, SAMPLES)))
    inside = passage.contains(x, y)
    middle = shape.representative_point()
    return np.append(x[inside], middle.x), np.append(y[inside], middle.y)


@dataclass(frozen=True)
class _Named:
    """Thing of the map that a text names or gives the position of; without a thing there, the position.

    words  name in a sentence: "the statue", or "(1, 2)" for a position
    shape  outline or position, m
    """

    words: str
    shape: BaseGeometry

    @classmethod
    def of(cls, world: World, text: str) -> _Named:
        """Return the obstacle, zone or landmark that a text names; QueryError if there is none, or several.

        For a text "x,y", m, return an obstacle there, else the position.
        """
        if match := POSITION.fullmatch(text.strip()):
            x, y = map(float, match.groups())
            place = Point(x, y)
            here = [o.polygon for o in world.obstacles if o.polygon.intersects(place)]
            return cls(f"({x:g}, {y:g})", here[0] if here else place)
        named = _named(world)
        name = _meant(text, named)
        if name is None:
            known = _listed(named)
            raise QueryError(
                f"no obstacle, zone or landmark of the map is called {shown(text.strip())}."
                f"{_near(text, named)} Known: {known}; or give a position x,y"
            )
        shapes = shapely.get_parts(shapely.union_all(named[name]))
        if len(shapes) > 1:
            middles = (f"{shape.representative_point().x:.4g},{shape.representative_point().y:.4g}" for shape in shapes)
            raise QueryError(
                f"{len(shapes)} things of the map are called {shown(name)}, at {'; '.join(middles)}: give the position "
                "of the one that is meant in place of the name"
            )
        return cls(_with_article(name), shapes[0])


def _near(text: str, names: Iterable[str]) -> str:
    """Return a question that suggests the most similar name, with or without "the"; "" if none is similar."""
    return did_you_mean(text.strip(), [each for name in names for each in (name, name.removeprefix("the "))])


def _with_article(name: str) -> str:
    """Return a name with "the" before it if it begins with a small letter: "the statue", but "Room 3"."""
    return name if name.lower().startswith("the ") or not name[:1].islower() else f"the {name}"


def _zones(world: World) -> dict[str, BaseGeometry]:
    """Return the areas of all zones of a world by name; zones with the same name are joined."""
    areas: dict[str, list[BaseGeometry]] = {}
    for zone in world.content.zones:
        if zone.name:
            areas.setdefault(zone.name, []).append(zone.area)
    return {name: shapely.union_all(several) for name, several in areas.items()}


def _named(world: World) -> dict[str, list[BaseGeometry]]:
    """Return the outlines, or positions, of all obstacles, zones and landmarks of a world that have a name, by name.

    A name of an obstacle hides the same name of a zone or landmark.
    """
    obstacles: dict[str, list[BaseGeometry]] = {}
    for obstacle in world.obstacles:
        if obstacle.name:
            obstacles.setdefault(obstacle.name, []).append(obstacle.polygon)
    marks: dict[str, list[BaseGeometry]] = {}
    for mark in world.content.landmarks:
        if mark.name:
            marks.setdefault(mark.name, []).append(Point(mark.x, mark.y))
    return marks | {name: [area] for name, area in _zones(world).items()} | obstacles


def _meant(text: str, names: Mapping[str, Any] | Sequence[str]) -> str | None:
    """Return the name that a text means, whatever its capitals and with or without "the"; None if there is none."""
    text = " ".join(text.split()).lower()
    for meant in (text, text.removeprefix("the ")):
        for name in names:
            if " ".join(name.split()).lower() in (meant, f"the {meant}"):
                return name
    return None


def _beside(problem: Problem, side: str, named: _Named) -> Passage:
    """Return the passage on one side of a thing, as seen along the straight line from start to goal."""
    start, goal = _ends(problem)
    way = goal - start
    length = float(np.hypot(*way))
    middle = np.array(named.shape.centroid.coords[0])
    if length == 0.0 or not 0.0 < float((middle - start) @ way) < length**2:
        raise QueryError(
            f"{named.words} does not lie between start and goal, seen along the straight line from ({start[0]:.4g}, "
            f"{start[1]:.4g}) to ({goal[0]:.4g}, {goal[1]:.4g}), so it has no {side} side there; name a region, or two "
            "things: between NAME and NAME"
        )
    outward = np.array([-way[1], way[0]]) / length * (1.0 if side == "left" else -1.0)
    corners = shapely.get_coordinates(named.shape)
    far = corners @ outward
    begin = corners[far >= far.max() - 1e-9].mean(axis=0)
    x0, y0, x1, y1 = problem.world.bounds
    end = begin + outward * float(np.hypot(x1 - x0, y1 - y0) + np.hypot(*(begin - [x0, y0])))
    return Passage(f"{side} of {named.words}", LineString([begin, end]), across=True)


def _between(world: World, text: str) -> Passage:
    """Return the passage between two things that a text "NAME and NAME" names."""
    words = re.split(r"\s+and\s+", text)
    pairs = [(" and ".join(words[:i]), " and ".join(words[i:])) for i in range(1, len(words))]
    if not pairs:
        raise QueryError(f"between needs two things of the map, between NAME and NAME; got {shown(f'between {text}')}")
    known = _named(world)

    def is_known(name: str) -> bool:
        return POSITION.fullmatch(name.strip()) is not None or _meant(name, known) is not None

    first, second = next((pair for pair in pairs if all(map(is_known, pair))), pairs[0])
    one, other = _Named.of(world, first), _Named.of(world, second)
    line = shapely.shortest_line(one.shape, other.shape)
    if line.length <= 1e-9:
        raise QueryError(f"{one.words} and {other.words} touch, so no path passes between them; name two other things")
    return _passage(world, line, f"between {one.words} and {other.words}")


def _ends(problem: Problem) -> tuple[FloatArray, FloatArray]:
    """Return the positions (2,), m, of start and goal; the mean position if there are several goals."""
    names, target = problem.model.space.names, problem.target
    columns = [names.index("x"), names.index("y")]
    start = np.array([problem.start[column] for column in columns], np.float64)
    listed = [[goal[column] for column in columns] for goal in target.listed]
    places = listed or [list(place[:2]) for place in target.places]
    if not places or any(value is None for place in places for value in place):
        raise QueryError(
            "left and right need a goal with a position, as seen from the start; name a region, or two things: between "
            "NAME and NAME"
        )
    return start, np.array(places, np.float64).mean(axis=0)


@dataclass(frozen=True)
class CostLimit:
    """Upper bounds of costs that a wish sets.

    words      the wish in words that follow "with": "fewer turns"
    bounds     largest value of each cost by name; with a ``reference``, the cost must be less than this value
    reference  row of the front whose cost is the bound; None if the user gave bounds in numbers
    """

    words: str
    bounds: dict[str, float]
    reference: int | None = None

    @classmethod
    def of(cls, wish: str | Mapping[str, float], front: Front, row: int) -> CostLimit:
        """Return the bounds of a wish: words such as "fewer turns", or bounds by name, ``{"turns": 3}``.

        Words mean less of the cost than the given row of the front has; "hurry" means less duration.
        """
        if isinstance(wish, str):
            match = LESS.fullmatch(wish.strip())
            if match is None and wish.strip().lower() != HURRY:
                near = did_you_mean(wish, [HURRY, *(f"fewer {name}" for name in front.names)])
                raise OptionError(
                    f"a wish must be 'hurry', a text such as 'fewer {front.names[0]}', or bounds such as "
                    f"{{'{front.names[0]}': 3}}; got {shown(wish)}. Costs are {', '.join(front.names)}.{near}"
                )
            name = _cost("duration" if match is None else match.group(1), front)
            more = "fewer" if name == "turns" else "less"
            return cls(f"{more} {spoken(name)}", {name: front[row].costs[name]}, row)
        bounds = {
            _cost(name, front): float(real(f"the wish for {name}", most, 0, np.inf)) for name, most in wish.items()
        }
        if not bounds:
            raise OptionError("a wish must bound a cost, such as {'turns': 3}, got none")
        units = dict(zip(front.names, front.units, strict=True))
        parts = (f"at most {most:.4g} {_bounded(name, units[name], most)}" for name, most in bounds.items())
        return cls(" and ".join(parts), bounds)

    def met(self, front: Front) -> BoolArray:
        """Return which rows (n,) of a front meet the bounds."""
        met = np.ones(len(front), np.bool_)
        for name, bound in self.bounds.items():
            j = front.names.index(name)
            met &= front.costs[:, j] <= (bound + 1e-9 if self.reference is None else bound - 0.5 * front.quanta[j])
        return met


def _cost(name: str, front: Front) -> str:
    """Return the name of the front's cost that a user means, whatever its capitals; UnknownName if there is none."""
    for known in front.names:
        if known.replace("_", " ") == str(name).strip().lower().replace("_", " "):
            return known
    raise UnknownName(
        f"there is no cost {shown(name)} to wish for.{did_you_mean(name, front.names)} The front has the costs "
        f"{', '.join(front.names)}; for another cost, plan with that criterion as well"
    )


def spoken(name: str) -> str:
    """Return the name of a cost with spaces for underscores."""
    return name.replace("_", " ")


def _bounded(name: str, unit: str, most: float) -> str:
    """Return what a bound of a cost counts: "turns", "m of length"."""
    if unit != "1":
        return f"{unit} of {spoken(name)}"
    return "turn" if (name, most) == ("turns", 1.0) else spoken(name)
