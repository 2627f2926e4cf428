"""Scenario files: a problem and its planners in YAML, with errors that name the key, the line and the fix.

::

    world:
      ros_map: {path: office/map.yaml}      # or movingai, geojson, image, dxf, pdf, ros_bag, polygons, moveit_scene,
                                            # point_cloud, solids, commonroad, a reader of an installed package
    model:
      differential_drive: {radius: 0.3, camera_height: 1.2}
    view: {turning: unwound}                # optional: the picture of its 360-degree camera is turned back (or: level)
    start: [2.0, 3.0, 0]                    # x m, y m, yaw rad, or "90 deg"; or by name, {x: 2.0, y: 3.0, yaw: 0}
    goal: [21.0, 9.0, any]                  # any: any heading; a list of goals: any of them
    # goal: {look_at: {target: [21, 9, 1.5], distance: [0.8, 2]}}    # or a goal for a body (`hpop goals`)
    criteria: [obstruction, turns, length]  # a name, or {name: {parameter: value}}
    planner:
      lattice: {step: 0.25}
    quanta: {length: 0.001}                 # optional, as all below: steps in which costs are compared
    people:
      - {x: 8.0, y: 5.0, yaw: 90 deg, name: Ada}
      - {x: 8.0, y: 6.2, yaw: -90 deg}
      - {x: 12.0, y: 4.0, velocity: [-0.8, 0], growth: 0.1}       # less certain by 0.1 m each second
      - {waypoints: [[0, 2, 7], [5, 6, 7], [9, 6, 3]], afterwards: stays}     # t s, x m, y m; then stays there
      - {x: 9.0, y: 5.0, futures: [{weight: 3, velocity: [0, 1]}, {weight: 1}]}     # goes on, or stands
      - {track: visitors.csv, frame_rate: 25, begin: 60}          # recorded by a camera, from second 60 on
    horizon: 8                              # s, up to which people are predicted
    groups: [[Ada, 1]]                      # people in conversation: indices from 0, or names
    landmarks:
      - {x: 15.0, y: 9.5, z: 1.6, facing: -90 deg, weight: 2, name: door}
    zones:
      - {kind: speed, area: [[3, 3], [6, 3], [6, 6]], limit: 0.5}
      - {kind: keep-out, area: [[9, 1], [10, 1], [10, 2]]}
      - {kind: one-way, area: [[3, 7], [9, 7], [9, 9], [3, 9]], path: [[3, 8], [9, 8]]}
    fields:                                 # quantities measured over the floor, for criteria such as field_exposure
      - {name: wifi, path: wifi.csv, unit: dBm, outside: -95}     # columns x, y, wifi; elsewhere it is -95 dBm
    tour:                                   # stops on the way to the goal
      order: any                            # or given, the default; or some: [[0, door]], pairs that keep their order
      stops:
        - {at: [6, 8], within: 1.5, dwell: 10, name: hall}        # m, m, s
        - {look_at: {target: [9, 6, 1.5], distance: [1, 2]}}      # any goal
        - {landmark: door, dwell: 5, optional: true}              # seen by the camera; see the criterion stops_missed
    choose: {preference: p07.json}          # marks the best "for you"; from `hpop prefer`

Every choice is one name with its parameters; paths are relative to the scenario file.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import shapely
from pydantic import BaseModel

from hpop.base.arrays import copied
from hpop.base.lazy import homes_of, on_first_use
from hpop.base.options import LEAST, MOST, real
from hpop.base.registry import criteria, models, planners, readers
from hpop.base.text import shown
from hpop.criteria.base import Criterion
from hpop.criteria.costs import with_quanta
from hpop.errors import LimitError, QueryError, StudyError, UnsupportedModel, did_you_mean
from hpop.goals import Tour
from hpop.motions import Model
from hpop.planners.base import Planner
from hpop.planners.needs import refuse_unsupported
from hpop.planners.objectives import integral_of
from hpop.planners.spending import OPTIONS, Exhausted, Spending, common_spending
from hpop.preference import Preference
from hpop.problems.problem import Problem
from hpop.runtime import limits
from hpop.scenario.events import groups_of, people_of
from hpop.scenario.faults import Faults
from hpop.scenario.roads import with_planning_problem
from hpop.scenario.schema import (
    DEFAULT_MODEL,
    DEFAULT_PLANNER,
    Choose,
    ContentFile,
    CylinderSize,
    FieldEntry,
    LandmarkEntry,
    MapFile,
    ReaderFile,
    ScenarioFile,
    SolidEntry,
    Solids,
    WorldSection,
    ZoneEntry,
)
from hpop.scenario.yaml_lines import Document, Place, entries
from hpop.world import MeasuredField, World, read_field
from hpop.world.content.content import Content, Landmark, Zone
from hpop.world.content.predictions import bounded
from hpop.world.geometry.outlines import check_joinable
from hpop.world.geometry.shapes import Obstacle, check_coordinates, check_heights
from hpop.world.geometry.solids import Box, Cylinder, Hull, Shape, Solid, Sphere, pose_at
from hpop.world.readers import geojson_content
from hpop.world.readers.moveit_frames import placed_scene
from hpop.world.readers.readers import read_world

if TYPE_CHECKING:  # imported on first use: start-up time
    from hpop.scenario import events as events
    from hpop.scenario import json_schema as json_schema
    from hpop.scenario import new as new

__getattr__ = on_first_use(__name__, homes_of(__name__))

SHAPES = ("box", "cylinder", "sphere", "hull")


@dataclasses.dataclass(frozen=True, eq=False)
class Scenario:
    """Content of a scenario file: its problem, its planners and, if given, a person's preference."""

    problem: Problem
    planners: tuple[Planner, ...]
    path: Path
    preference: Preference | None = None


def load_scenario(path: str | Path) -> Scenario:
    """Read, check and build a scenario from a YAML file.

    Everything except the world is checked first. All faults are reported together, in the order of the file, each with
    file, line and key. Faults of one kind are raised as that kind (UnknownName, ModelError, CriterionError,
    OptionError, QueryError); faults of the file's form, or of several kinds, as ScenarioError. Then the world is read:
    this raises MapError, or LimitError if reading it passes the limits of all planners.
    """
    return read_scenario(Document(Path(path)), {})


def read_scenario(document: Document, worlds: dict[str, World]) -> Scenario:
    """Check and build the scenario in a YAML document; see :func:`load_scenario`.

    ``worlds`` is a cache of the worlds that were read, by the text of their section, so that scenarios with equal
    sections share one world.
    """
    given, faults = document.values, Faults(document)
    faults.no_map()
    reader = _plugin_reader(given.get("world"))
    file = faults.validated(ScenarioFile, given if reader is None else {**given, "world": {}}, ())
    to_read = None if reader is None else faults.validated(ReaderFile, given["world"][reader], ("world", reader))
    if reader is None:
        faults.one_world(given.get("world"))
    model = faults.built(models, given.get("model", DEFAULT_MODEL), ("model",))
    if isinstance(view := given.get("view"), dict):
        model = _viewed(faults, view, model)
    wanted = [faults.built(criteria, spec, ("criteria", i)) for i, spec in enumerate(entries(given.get("criteria")))]
    asked = given.get("planner", DEFAULT_PLANNER)
    chosen = (
        [faults.built(planners, spec, ("planner", i)) for i, spec in enumerate(asked)]
        if isinstance(asked, list)
        else [faults.built(planners, asked, ("planner",))]
    )
    for i, planner in enumerate(chosen):
        if planner is not None and isinstance(model, Model):
            try:
                refuse_unsupported(cast(Planner, planner), model)
            except UnsupportedModel as error:
                place = ("planner", i) if isinstance(asked, list) else ("planner",)
                default = f"no planner is given, and the default is {DEFAULT_PLANNER}: " * ("planner" not in given)
                faults.add((*place, cast(Planner, planner).name), f"{default}{error}", UnsupportedModel)
    given = with_planning_problem(faults, given, file)
    robot = model if isinstance(model, Model) else None
    space = None if robot is None else robot.space
    start: Any = faults.state(given["start"], ("start",), space) if "start" in given else None
    goal: Any = faults.goal(given["goal"], ("goal",), robot) if "goal" in given else None
    tour = faults.tour(given.get("tour"), ("tour",), robot)
    entered = people_of(faults, given.get("people"))
    landmarks = faults.made(given.get("landmarks"), ("landmarks",), LandmarkEntry, partial(_landmark, faults))
    zones = faults.made(given.get("zones"), ("zones",), ZoneEntry, _zone)
    solids = faults.made(_solid_entries(given), ("world", "solids", "obstacles"), SolidEntry, partial(_solid, faults))
    fields = faults.made(given.get("fields"), ("fields",), FieldEntry, partial(_field, faults))
    groups = groups_of(faults, given.get("groups"), entered)
    faults.raise_all()
    preference = _preference(faults, document.path.parent, file.choose, cast(list[Criterion], wanted))
    asked_quanta = given.get("quanta")
    with faults.collected(("quanta",)):
        with_quanta(cast(list[Criterion], wanted), asked_quanta)
    with faults.collected(("groups",)):
        people = [person for entry in entered for person in entry or ()]
        content = Content(*map(tuple, (people, groups, landmarks, zones)))  # type: ignore[arg-type]
    faults.raise_all()
    folder, spending = document.path.parent, common_spending(cast(list[Planner], chosen))
    given_as = reader or next(name for name, value in file.world if value is not None)
    with faults.collected(("world", given_as)), _reading(spending):
        section = json.dumps(given.get("world"), sort_keys=True)
        if section not in worlds:
            worlds[section] = (
                _bare_world(file.world, folder, cast(list[Solid], solids))
                if reader is None or to_read is None
                else read_world(reader, folder / to_read.path, **to_read.model_extra)
            )
        bare = worlds[section]
        world = _with_notes(_furnished(bare, file.world, folder, content), tuple(faults.notes))
    read_seconds = spending.seconds()
    faults.raise_all()
    with faults.collected(("fields",)):
        world = world.with_fields(cast(list[MeasuredField], fields)) if fields else world
    with faults.collected(("horizon",)):
        if file.horizon is not None:
            real("horizon", file.horizon, LEAST, MOST, "a time in s", error=QueryError)
    with faults.collected(("people",)):
        bounded(world, file.horizon)
    faults.raise_all()
    if tour is not None:
        tour = _fitting(faults, tour, cast(Model, model), world)
    with faults.collected(("world", given_as)):
        if world.link_rules.frames:
            placed_scene(world, cast(Model, model).with_scene(world))
    faults.raise_all()
    with faults.collected(("criteria",)):
        listed = cast(list[Criterion], wanted)
        asked_for: dict[str, Any] = {"quanta": asked_quanta, "horizon": file.horizon, "tour": tour}
        problem = Problem(world, cast(Model, model), start, goal, listed, **asked_for)
        problem = copied(problem, read_seconds=read_seconds, read_memory=spending.memory)
    faults.raise_all()
    return Scenario(problem, tuple(cast(list[Planner], chosen)), document.path, preference)


def _viewed(faults: Faults, view: dict[str, Any], robot: object) -> object:
    """Return the view that a scenario asks for, of its robot; None if either has a fault."""
    if "model" in view:
        faults.add(("view", "model"), "the robot of the view is given by model, beside view; move it there")
    made: Any = faults.built(models, {"view": {key: value for key, value in view.items() if key != "model"}}, ())
    with faults.collected(("view",)):
        return made and robot and dataclasses.replace(made, model=robot)
    return None


def _fitting(faults: Faults, tour: Tour, model: Model, world: World) -> Tour:
    """Return a tour with the goals of its stops as objects; add a fault for each stop that does not fit."""
    stops = [*tour.stops]
    for i, stop in enumerate(stops):
        with faults.collected(("tour", "stops", i)):
            stops[i] = stop.on(model, world)
    return dataclasses.replace(tour, stops=tuple(stops))


@contextmanager
def _reading(spending: Spending) -> Iterator[None]:
    """Enforce the planners' limits while the world is read; raise LimitError if one is passed."""
    try:
        with limits.within(spending):
            yield
    except Exhausted as stop:
        raise LimitError(
            f"{stop.status} reached while {stop.doing}, before planning began; raise {OPTIONS[stop.status]} of the "
            "planner, or give a smaller map"
        ) from None


def _preference(faults: Faults, folder: Path, choose: Choose | None, wanted: Sequence[Criterion]) -> Preference | None:
    """Load the preference of a person that `choose` names; None if there is none.

    The preference marks a trajectory "for you", so every cost that it weighs must be a cost of the front.
    """
    if choose is None:
        return None
    place = ("choose", "preference")
    with faults.collected(place):
        try:
            person = Preference.load(folder / choose.preference)
        except OSError as error:
            hint = "give the file that `hpop prefer` wrote, from the folder of the scenario"
            faults.add(place, f"cannot read {choose.preference}: {error.strerror or error}; {hint}", StudyError)
            return None
        means = [criterion for criterion in wanted if criterion.aggregate == "time-mean"]
        known = [criterion.name for criterion in (*wanted, *map(integral_of, means))]
        for name in person.scale.names:
            if name not in known:
                raise StudyError(
                    f"the preference weighs {shown(name)}, which is no criterion here.{did_you_mean(name, known)} Add "
                    f"it to criteria ({', '.join(known)}), or ask again with `hpop prefer`"
                )
        return person
    return None


def _landmark(faults: Faults, entry: LandmarkEntry, place: Place) -> Landmark:
    """Build a landmark from its entry in the scenario, at ``place`` in the file; add wrong values to ``faults``."""
    return Landmark(**{**_given(entry), "facing": faults.angle(entry.facing, (*place, "facing"), "a direction")})


def _solid_entries(given: Any) -> Any:
    """Return the list of solids under ``world: solids: obstacles``; None if the world is given otherwise."""
    for key in ("world", "solids", "obstacles"):
        given = given.get(key) if isinstance(given, dict) else None
    return given


def _solid(faults: Faults, entry: SolidEntry, place: Place) -> Solid | None:
    """Build a solid from its entry in the scenario; note its faults, and return None without one shape or one pose."""
    shapes = [name for name in SHAPES if getattr(entry, name) is not None]
    if len(shapes) != 1:
        faults.add(place, f"give exactly one of {', '.join(SHAPES)}; got {' and '.join(shapes) or 'none'}")
        return None
    if entry.rpy is not None and entry.quaternion is not None:
        faults.add(place, "give rpy or quaternion, not both")
        return None
    angles = [faults.angle(angle, (*place, "rpy", i), "an angle") for i, angle in enumerate(entry.rpy or (0.0,) * 3)]
    match entry:
        case SolidEntry(box=(_, _, _) as size):
            shape: Shape = Box(size)
        case SolidEntry(cylinder=CylinderSize() as size):
            shape = Cylinder(size.radius, size.length)
        case SolidEntry(sphere=float() as radius):
            shape = Sphere(radius)
        case _:
            shape = Hull(entry.hull)  # type: ignore[arg-type]  # it makes an array of them
    return Solid(shape, pose_at(entry.position, rpy=angles, quaternion=entry.quaternion), entry.name)


def _given(entry: BaseModel) -> dict[str, Any]:
    """Return the values that an entry sets, without defaults."""
    return {key: getattr(entry, key) for key in entry.model_fields_set}


def _field(faults: Faults, entry: FieldEntry, place: Place) -> MeasuredField:
    """Read a measured field as its entry in the scenario says."""
    return read_field(**{**_given(entry), "path": faults.beside(entry.path)})


def _zone(entry: ZoneEntry, place: Place) -> Zone:
    """Build a zone from its entry in the scenario."""
    path = None if entry.path is None else shapely.LineString(entry.path)
    return Zone(**{**_given(entry), "area": shapely.Polygon(entry.area), "path": path})


def _plugin_reader(section: Any) -> str | None:
    """Return the name of an installed package's reader, if the world section names one; None for hpop's readers."""
    if not isinstance(section, dict) or len(section) != 1:
        return None
    (name,) = section
    return name if name not in WorldSection.model_fields and name in readers else None


def _furnished(world: World, section: WorldSection, folder: Path, content: Content) -> World:
    """Return a world with people, landmarks and zones, including those from GeoJSON files that its section names."""
    landmarks, zones = content.landmarks, content.zones
    if section.geojson is not None:
        given = section.geojson
        paths: dict[str, Any] = {
            role: [_content_file(file, folder) for file in (named if isinstance(named, list) else [named])]
            for role, named in (("landmarks", given.landmarks), ("flows", given.flows), ("zones", given.zones))
        }
        found = cast(dict[str, Any], world.source)["options"]  # includes options that the reader found in the file
        placed = {key: found.get(key) for key in ("scale", "origin", "units", "crs")}
        read, notes = geojson_content.read(**paths, **placed, width=given.flow_width)
        landmarks, zones = read.landmarks + landmarks, read.zones + zones
        world = _with_notes(world, notes)
    if not (content.people or landmarks or zones):
        return world
    people, zones = content.people + world.content.people, zones + world.content.zones  # those of a road come last
    return world.with_content(people=people, groups=content.groups, landmarks=landmarks, zones=zones)


def _content_file(file: str | ContentFile, folder: Path) -> Path | dict[str, Any]:
    """Return a GeoJSON file of landmarks, flows or zones as its reader takes it, with the path resolved."""
    return folder / file if isinstance(file, str) else {"path": folder / file.path, "where": file.where}


def _with_notes(world: World, notes: tuple[str, ...]) -> World:
    """Return a world with more notes (texts to print)."""
    noted = dataclasses.replace(world, notes=world.notes + notes)
    return noted if world.source is None else noted.read_from(world.source)


def _bare_world(section: WorldSection, folder: Path, solids: list[Solid]) -> World:
    """Build the world of a section, without people, landmarks and zones of the scenario.

    Paths are relative to the folder.
    """
    name, given = next((name, value) for name, value in section if value is not None)
    if isinstance(given, MapFile):
        options = {key: value for key, value in _given(given).items() if key not in given.beside}
        paths = {key: folder / options[key] for key in given.files & options.keys() if options[key] is not None}
        return read_world(name, **{**options, **paths})
    extent = None if given.extent is None else shapely.Polygon(given.extent)
    if isinstance(given, Solids):
        return World.from_solids(solids, extent=extent)
    prisms = [
        Obstacle(shapely.Polygon(p.corners), *check_heights(p.height or (None, None)), contrast=p.contrast)
        for p in given.obstacles
    ]
    closed = [shapely.Polygon(corners) for corners in given.keep_out]
    for polygon in closed:
        check_coordinates(polygon, "keep_out")
    check_joinable(closed, "keep_out")
    return World.from_polygons(prisms, extent=extent, keep_out=shapely.union_all(closed) if closed else None)
