"""Reader for roads in CommonRoad XML, versions 2018b and 2020a: lanes, speed limits, obstacles, and traffic.

The robot stays on the lanes for cars. Their directions are one-way zones, their speed limits speed zones. A vehicle
that moves is covered by discs, each a person with a recorded track, so a search with a clock avoids it. A planning
problem of the file is read by `planning_problem`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from shapely.affinity import rotate, translate
from shapely.geometry.base import BaseGeometry

from hpop.base.options import truth
from hpop.base.text import counted, printable, shown, some
from hpop.errors import MapError
from hpop.runtime import limits
from hpop.runtime.limits import READING
from hpop.world.content.content import Content, Zone
from hpop.world.content.people import WIDEST, Person
from hpop.world.files import file_source, named
from hpop.world.geometry.shapes import Obstacle, check_heights
from hpop.world.ground import Ground, Heights
from hpop.world.readers.road_file import SAME, Lane, RoadFile, RoadState, Shape, polygons_of
from hpop.world.tracks import Track
from hpop.world.world import World

GAP = 0.05
"""Half of the width, m, of gaps between lanes that are closed: errors of rounding and of surveying."""
SLIVER = 0.01
"""Share of a lane's area up to which another lane only touches it; also the smallest area of a zone, m²."""
WIDE = 2.6
"""Largest width, m, that one row of discs covers; their radius is at most about 0.7 of it."""
LOOSE = 0.2  # rad: width of an interval of headings above which a note says which one is chosen
MOST_DISCS = 200  # of one vehicle
FINEST = 0.2  # m: smallest distance between discs
FINER = (1, 2, 4)  # tried in turn: factors of the number of discs across a vehicle whose states are uncertain
ROLES = {"staticObstacle": "static", "dynamicObstacle": "dynamic", "environmentObstacle": "static", "obstacle": ""}
"""Elements of obstacles, with their role; "" if a child states it."""
Place = tuple[float, float, float | None]


class PlanningProblem(NamedTuple):
    """Start and goals of a planning problem, for the middle of a car's rear axle: x m, y m, yaw rad.

    A yaw is None if the file leaves it free. The goals are alternatives: a state in the middle of each lane that
    crosses the area of the goal.
    """

    start: Place
    goals: tuple[Place, ...]
    notes: tuple[str, ...]


def read(path: str | Path, *, height: Heights | None = None, traffic: bool = True) -> World:
    """Read the lanes for cars as the extent, with zones, obstacles, and moving vehicles as people.

    height   (z_min, z_max) of obstacles, m, which the file does not state; None for no limits
    traffic  whether vehicles that move are read

    Gaps between lanes up to 10 cm wide are closed. Beyond the lanes nothing obstructs the camera. A one-way zone leaves
    out the parts of its lane that other lanes cross. Lanes for pedestrians or bicycles are no part of the road, and
    signs other than speed limits are not read, nor are traffic lights; ``world.notes`` say what was left out.

    Raises
    ------
    MapError
        If the file is missing, is no CommonRoad of a known version, or an element cannot be read; the message names it.
    """
    file = RoadFile.of(path)
    lanes = file.lanes()
    truth("traffic", traffic, error=MapError)
    areas = shapely.union_all([lane.area for lane in lanes])
    closed = areas.buffer(GAP, join_style="mitre").buffer(-GAP, join_style="mitre")
    extent = shapely.union_all(list(polygons_of(shapely.union(areas, closed))))
    obstacles, people = list[Obstacle](), list[Person]()
    low, high = check_heights(height or (None, None))
    for given in file.root:
        if given.tag in ROLES:
            limits.check(READING)
            what = f"{given.tag} {printable(given.get('id', '?'))[:20]}"
            _read_obstacle(file, given, what, (low, high), obstacles, people)
    notes = [*file.notes, *_notes(file, lanes, people, traffic)]
    content = Content(people=tuple(people) if traffic else (), zones=(*_speed_zones(lanes), *_one_way_zones(lanes)))
    ground = Ground(tuple(obstacles), extent=extent, outside_is_obstacle=False)
    options = {"height": None if height is None else list(height), "traffic": traffic}
    world = World(ground, notes=tuple(notes), content=content)
    return world.read_from(file_source("commonroad", path, options, file.data))


def planning_problem(path: str | Path, number: int | None = None) -> PlanningProblem:
    """Read the start and the goals of a planning problem in a road file; give its number (id) if there are several.

    Raises MapError if there is none of this number, or it has no start at time 0, or no goal with a position.
    """
    file = RoadFile.of(path)
    problems = {problem.get("id", "?"): problem for problem in file.root.findall("planningProblem")}
    known = ", ".join(printable(each)[:20] for each in problems)
    if not problems:
        raise file.error("it has no <planningProblem>; give start and goal as states, such as [2, 3, 0]")
    if number is None and len(problems) > 1:
        raise file.error(f"it has several planning problems; give the number of one of them: {known}")
    if number is not None and str(number) not in problems:
        raise file.error(f"it has no planning problem {shown(number)}; give one of {known}")
    chosen = str(number) if number is not None else next(iter(problems))
    what, given = f"planning problem {printable(chosen)[:20]}", problems[chosen]
    begin = given.find("initialState")
    if begin is None:
        raise file.error(f"{what} needs an <initialState>; add it, or give start as a state")
    start = file.state(begin, f"the initial state of {what}")
    if start.time != 0.0 or math.isnan(start.yaw):
        raise file.error(
            f"the initial state of {what} needs time 0 and an orientation; give start as a state, [x, y, yaw]"
        )
    lanes = file.lanes()
    place = f"{named(path)}, {what}"
    said = [f"{place}: start and goals are those of the middle of the rear axle; times and speeds are left out"]
    goals = [goal for state in given.findall("goalState") for goal in _goals(file, state, lanes, what, said)]
    if not goals:
        raise file.error(f"no goal of {what} states a position; give goal as a state, [x, y, yaw]")
    return PlanningProblem((start.x, start.y, start.yaw), tuple(dict.fromkeys(goals)), tuple(said))


def _goals(file: RoadFile, state: Element, lanes: Sequence[Lane], what: str, said: list[str]) -> list[Place]:
    """Return a state (x, y, yaw) in the middle of each lane that crosses the position of a goal state.

    said  notes for the user, to which one is added if the heading is a guess
    """
    position = state.find("position")
    if position is None:
        return []
    refs = {ref.get("ref", "?") for ref in position.findall("lanelet")}
    if unknown := refs - {lane.number for lane in lanes}:
        raise file.error(
            f"a goal of {what} refers to lanelet{'s' * (len(unknown) > 1)} {some(sorted(unknown))}: the file has no "
            "lane for cars with this id; correct the id, or give goal as a state, [x, y, yaw]"
        )
    shapes = [shape.area for shape in file.shapes(position, f"a goal of {what}")]
    shapes += [shapely.Point(point).buffer(GAP) for point in file.points(position, f"a goal of {what}")]
    region = shapely.union_all(shapes)
    turned = file.span(state, "orientation", f"a goal of {what}")
    found = list[Place]()
    for lane in lanes:
        line = lane.middle
        within = None if line is None else line if lane.number in refs else shapely.intersection(line, region)
        if line is None or within is None or not within.length > 0:
            continue
        longest = max(shapely.get_parts(within), key=lambda part: float(part.length))
        middle = longest.interpolate(0.5, normalized=True)
        found.append((middle.x, middle.y, _within(lane.heading(float(line.project(middle))), turned)))
    if not found and not region.is_empty:
        point, yaw = region.representative_point(), None if turned is None else sum(turned) / 2
        if turned is not None and turned[1] - turned[0] > LOOSE:
            said.append(
                f"{named(file.path)}: a goal of {what} is on no lane; of its headings from {turned[0]:.3g} to "
                f"{turned[1]:.3g} rad, the middle is the goal. Give goal as a state, [x, y, yaw], for another one"
            )
        found.append((point.x, point.y, yaw))
    return found


def _within(yaw: float, turned: tuple[float, float] | None) -> float:
    """Return the heading within an interval, rad, that is nearest to a yaw; None stands for any heading."""
    if turned is None:
        return yaw
    middle, half = sum(turned) / 2, (turned[1] - turned[0]) / 2
    off = math.remainder(yaw - middle, math.tau)
    return middle + min(max(off, -half), half)


def _read_obstacle(
    file: RoadFile, given: Element, what: str, height: Heights, obstacles: list[Obstacle], people: list[Person]
) -> None:
    """Append an obstacle of the file to ``obstacles`` if it stands, or its discs to ``people`` if it moves."""
    role = ROLES[given.tag] or (given.findtext("role") or "").strip()
    if role not in ("static", "dynamic"):
        raise file.error(f"the <role> of {what} must be static or dynamic; correct it")
    if given.find("occupancySet") is not None:
        raise file.error(f"{what} has an <occupancySet>, which is not read; give it a <trajectory>, or leave it out")
    outline = given.find("shape")
    shapes = [] if outline is None else file.shapes(outline, what)
    if not shapes:
        raise file.error(f"{what} needs a <shape> with a rectangle, circle or polygon; add one")
    begin, way = given.find("initialState"), given.find("trajectory")
    if begin is None and given.tag != "environmentObstacle":
        raise file.error(f"{what} needs an <initialState>; add it")
    name = f"{printable(given.findtext('type') or 'obstacle')[:30]} {printable(given.get('id', '?'))[:20]}"
    states = [] if begin is None else [file.state(begin, f"the initial state of {what}")]
    later = [] if role == "static" or way is None else way.findall("state")
    if not later:
        area: BaseGeometry = shapely.union_all([shape.area for shape in shapes])
        if states:
            round_all = all(shape.radius is not None and shape.middle == (0.0, 0.0) for shape in shapes)
            if math.isnan(states[0].yaw) and not round_all:
                raise file.error(f"{what} has no <orientation> in its <initialState>; add it")
            area = _placed(area, states[0])
        obstacles += [Obstacle(part, *height, name=name) for part in polygons_of(area)]
        return
    states += [file.state(state, f"state {i} of {what}") for i, state in enumerate(later, 1)]
    people += _vehicle(file, shapes, sorted(states, key=lambda state: state.time), name, what)


def _placed(area: BaseGeometry, state: RoadState) -> BaseGeometry:
    """Return a shape at a state, enlarged by the blur and the swing of the state."""
    turned = rotate(area, 0.0 if math.isnan(state.yaw) else state.yaw, origin=(0, 0), use_radians=True)
    reach = float(np.hypot(*shapely.get_coordinates(area).T).max())
    grown = state.blur + reach * state.swing
    moved = translate(turned, state.x, state.y)
    return moved.buffer(grown) if grown > 0 else moved


def _vehicle(
    file: RoadFile, shapes: Sequence[Shape], states: Sequence[RoadState], name: str, what: str
) -> list[Person]:
    """Return people with recorded tracks whose bodies cover a moving vehicle."""
    times, x, y, yaw, blur, swing = (np.array(column) for column in zip(*states, strict=True))
    fresh = np.append(True, np.diff(times) > 0)
    times, x, y, yaw = times[fresh], x[fresh], y[fresh], yaw[fresh]
    if len(times) < 2:
        raise file.error(f"the states of {what} must have two or more different times; correct their steps")
    if np.isnan(yaw).any():  # it faces where it goes; at rest, where it faced before
        right, up = np.gradient(x), np.gradient(y)
        ahead = np.where(np.hypot(right, up) > SAME, np.arctan2(up, right), np.nan)
        yaw = np.where(np.isnan(yaw), ahead, yaw)
        stated = np.flatnonzero(~np.isnan(yaw))
        if not stated.size:
            raise file.error(f"{what} neither moves nor has an orientation; add its <orientation>")
        yaw = yaw[stated[np.maximum(np.searchsorted(stated, np.arange(yaw.size), side="right") - 1, 0)]]
    people, most = [], float(swing.max())
    for fine in FINER:
        discs = [
            (ahead, left, radius + float(blur.max()) + math.hypot(ahead, left) * most)
            for shape in shapes
            for ahead, left, radius in _discs(shape, fine)
        ]
        if len(discs) > MOST_DISCS:
            raise file.error(f"{what} would need {len(discs):,} discs, more than {MOST_DISCS}; check its size, in m")
        if max(radius for _, _, radius in discs) <= WIDEST:
            break
    for number, (ahead_by, left_by, radius) in enumerate(discs, 1):
        cos, sin = np.cos(yaw), np.sin(yaw)
        if radius > WIDEST:
            raise file.error(
                f"{what}: its uncertain states need discs of {radius:.3g} m radius, more than {WIDEST:g} m; narrow the "
                "intervals of its states"
            )
        part = f", disc {number} of {len(discs)}" if len(discs) > 1 else ""
        try:
            track = Track(
                times,
                x + ahead_by * cos - left_by * sin,
                y + ahead_by * sin + left_by * cos,
                recorded=True,
                vehicle=True,
            )
        except MapError as error:
            raise file.error(f"{what}: {str(error).rstrip('.')}") from None
        people.append(Person.along(track, radius=radius, name=f"{name}{part}"))
    return people


def _discs(shape: Shape, fine: int) -> list[tuple[float, float, float]]:
    """Return discs (ahead m, left m, radius m) that cover a shape in its vehicle's frame, ``fine`` times as small."""
    if shape.radius is not None and shape.radius <= WIDEST / 2 and fine == 1:
        return [(*shape.middle, shape.radius)]
    x0, y0, x1, y1 = shape.area.bounds
    side = min(x1 - x0, y1 - y0, WIDE) / fine
    rows, columns = (max(1, math.ceil(length / max(side, FINEST) - SLIVER)) for length in (y1 - y0, x1 - x0))
    tall, long = (y1 - y0) / rows, (x1 - x0) / columns
    radius = math.hypot(long, tall) / 2
    return [(x0 + (i + 0.5) * long, y0 + (j + 0.5) * tall, radius) for j in range(rows) for i in range(columns)]


def _speed_zones(lanes: Sequence[Lane]) -> list[Zone]:
    """Return a speed zone for each speed limit, the union of its lanes."""
    stated = sorted({lane.limit for lane in lanes if lane.limit is not None})
    found = []
    for limit in stated:
        area = shapely.union_all([lane.area for lane in lanes if lane.limit == limit])
        found.append(Zone("speed", shapely.union_all(list(polygons_of(area))), limit=limit))
    return found


def _one_way_zones(lanes: Sequence[Lane]) -> list[Zone]:
    """Return a one-way zone for each lane of one direction, without the parts that other lanes cross."""
    tree = shapely.STRtree([lane.area for lane in lanes])
    found = []
    for i, lane in enumerate(lanes):
        if not lane.one_way or lane.middle is None:
            continue
        crossing = [lanes[j].area for j in tree.query(lane.area).tolist() if j != i]
        cut = [area for area in crossing if shapely.intersection(area, lane.area).area > SLIVER * lane.area.area]
        area = shapely.difference(lane.area, shapely.union_all(cut)) if cut else lane.area
        area = shapely.union_all([part for part in polygons_of(area) if part.area > SLIVER])
        if not area.is_empty:
            found.append(Zone("one-way", area, path=lane.middle, name=f"lane {lane.number}"))
    return found


def _notes(file: RoadFile, lanes: Sequence[Lane], people: Sequence[Person], traffic: bool) -> list[str]:
    """Return notes on limits that are not stated, and on parts of the file that are not read."""
    place, found = named(file.path), []
    free = sum(lane.limit is None for lane in lanes)
    if free:
        which = "no lane states" if free == len(lanes) else f"{free} of {counted(len(lanes), 'lane')} do not state"
        found.append(
            f"{place}: {which} a speed limit; the car's own speed holds there. Add zones of kind speed to limit it"
        )
    if people and not traffic:
        found.append(f"{place}: vehicles that move are left out (traffic: false)")
    for tag, said in (("trafficLight", "traffic light"), ("phantomObstacle", "phantom obstacle")):
        if count := len(file.root.findall(tag)):
            found.append(f"{place} has {counted(count, said)}, not read")
    return found
