"""Scenario files: a problem and its planners in YAML, with errors that name the key, the line and the fix.

::

    world:
      ros_map: {path: office/map.yaml}      # or movingai, geojson, image, polygons
    model:
      differential_drive: {radius: 0.3, camera_height: 1.2}
    start: [2.0, 3.0, 0]                    # x m, y m, yaw rad, or "90 deg"
    goal: [21.0, 9.0, any]                  # any: every heading will do
    criteria: [obstruction, turns, length]  # a name, or {name: {parameter: value}}
    planner:
      lattice: {step: 0.25}

Every choice is one name with its parameters; paths are relative to the scenario file.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal, cast, get_type_hints

import shapely
from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from hpop.criteria.base import Criterion
from hpop.errors import HpopError, ScenarioError
from hpop.models import DifferentialDrive
from hpop.planners.base import Planner
from hpop.problem import Problem
from hpop.registry import Registry, criteria, models, planners
from hpop.world import World
from hpop.yaml_lines import Document, Place

STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
PARAMETERS = ConfigDict(**STRICT, arbitrary_types_allowed=True, protected_namespaces=())
DEFAULT_MODEL = "differential_drive"
DEFAULT_PLANNER = "lattice"
EXPECTED = {
    "string_type": "text",
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "int_parsing": "a whole number",
    "bool_type": "true or false",
    "finite_number": "a finite number",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "keys with values",
    "model_type": "keys with values",
}
"""What pydantic's kinds of fault expect, in the words of this file."""
DEGREES = re.compile(r"\s*([-+]?\d+(?:\.\d*)?)\s*deg\s*")
Point = tuple[float, float]
Heights = tuple[float, float]


class _Strict(BaseModel):
    model_config = STRICT


class RosMap(_Strict):
    """A ROS map_server map; ``keep_out`` is a mask of the same kind."""

    path: str
    unknown_is_free: bool = False
    keep_out: str | None = None
    height: Heights | None = None


class MovingAI(_Strict):
    """A MovingAI grid map; ``resolution`` is the side of a cell, m."""

    path: str
    resolution: float = Field(default=1.0, gt=0)


class GeoJSON(_Strict):
    """A GeoJSON floor plan; coordinates less ``origin`` times ``scale`` are metres."""

    path: str
    scale: float = Field(default=1.0, gt=0)
    origin: Point = (0.0, 0.0)
    polygons: Literal["obstacles", "free", "outline"] = "obstacles"


class Image(_Strict):
    """A blueprint image in which dark is obstacle; ``resolution`` is the side of a pixel, m."""

    path: str
    resolution: float = Field(gt=0)
    threshold: float = Field(default=0.5, gt=0, lt=1)
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    height: Heights | None = None


class Prism(_Strict):
    """An obstacle: corners in m, and the heights between which it stands; without, the whole height."""

    corners: list[Point] = Field(min_length=3)
    height: Heights | None = None


class Polygons(_Strict):
    """Obstacles written out; the robot stays in ``extent`` and off ``keep_out``."""

    obstacles: list[Prism] = []
    extent: list[Point] | None = Field(default=None, min_length=3)
    keep_out: list[list[Point]] = []


class WorldSection(_Strict):
    """Exactly one of the ways to give a world."""

    ros_map: RosMap | None = None
    movingai: MovingAI | None = None
    geojson: GeoJSON | None = None
    image: Image | None = None
    polygons: Polygons | None = None


Named = dict[str, dict[str, Any] | None]


class ScenarioFile(_Strict):
    """The keys of a scenario file."""

    world: WorldSection
    model: str | Named = DEFAULT_MODEL
    start: tuple[float, float, float | str]
    goal: tuple[float, float, float | str]
    criteria: list[str | Named] = Field(min_length=1)
    planner: str | Named | Annotated[list[str | Named], Field(min_length=1)] = DEFAULT_PLANNER


@dataclasses.dataclass(frozen=True, eq=False)
class Scenario:
    """What a scenario file asks for."""

    problem: Problem
    planners: tuple[Planner, ...]
    path: Path


def load_scenario(path: str | Path) -> Scenario:
    """Read, check and build a scenario.

    Everything but the world is checked before anything is reported: all faults at once, in the order of the file, each
    with file, line and key. One kind of fault is raised as what it is (UnknownName, ModelError, CriterionError,
    OptionError, QueryError), the file's form and several kinds together as ScenarioError; then MapError for the world.
    """
    document = Document(Path(path))
    given, faults = document.values, Faults(document)
    file = faults.validated(ScenarioFile, given, ())
    faults.one_world(given.get("world"))
    model = faults.built(models, given.get("model", DEFAULT_MODEL), ("model",))
    wanted = [faults.built(criteria, spec, ("criteria", i)) for i, spec in enumerate(_entries(given.get("criteria")))]
    asked = given.get("planner", DEFAULT_PLANNER)
    chosen = (
        [faults.built(planners, spec, ("planner", i)) for i, spec in enumerate(asked)]
        if isinstance(asked, list)
        else [faults.built(planners, asked, ("planner",))]
    )
    start, goal = (faults.pose(given.get(key), key) for key in ("start", "goal"))
    faults.raise_all()
    with faults.collected(("world", next(name for name, value in file.world if value is not None))):
        world = _world(file.world, document.path.parent)
    faults.raise_all()
    with faults.collected(("criteria",)):
        problem = Problem(world, cast(DifferentialDrive, model), start, goal, cast(list[Criterion], wanted))
    faults.raise_all()
    return Scenario(problem, tuple(cast(list[Planner], chosen)), document.path)


def _entries(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


class Faults:
    """What is wrong with a scenario, collected so that all of it is said at once."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._found: list[tuple[int, HpopError]] = []

    def add(self, place: Place, text: str, kind: type[HpopError] = ScenarioError) -> None:
        """Note a fault at a place of the file."""
        self._found.append((self._document.line(place), kind(f"{self._document.where(place)}: {text}")))

    def raise_all(self) -> None:
        """Raise what was collected, in the order of the file: as its own kind if there is one only."""
        if not self._found:
            return
        errors = [error for _, error in sorted(self._found, key=lambda fault: fault[0])]
        kinds = {type(error) for error in errors}
        kind = kinds.pop() if len(kinds) == 1 else ScenarioError
        raise kind("\n".join(dict.fromkeys(map(str, errors))))

    @contextmanager
    def collected(self, place: Place) -> Iterator[None]:
        """Note what the parts of hpop, or a plugin's constructor, say of a value."""
        try:
            yield
        except HpopError as error:
            self.add(place, str(error), type(error))
        except (TypeError, ValueError, shapely.errors.ShapelyError) as error:
            self.add(place, str(error))

    def validated(self, schema: type[BaseModel], values: Any, place: Place) -> Any:
        """Values checked against a schema, strictly; None after noting one fault a place."""
        try:
            return schema.model_validate_json(json.dumps(values))
        except ValidationError as error:
            details = [(self._place(place, fault["loc"]), fault) for fault in error.errors()]
        places = [where for where, _ in details]
        for where in dict.fromkeys(places):
            below = any(other[: len(where)] == where != other for other in places)
            here = [fault for at, fault in details if at == where]
            if below and all(fault["type"] in EXPECTED for fault in here):
                continue  # the branches of a choice that do not fit what was meant
            self.add(where, _said(schema, where[len(place) :], here))
        return None

    def _place(self, place: Place, loc: tuple[str | int, ...]) -> Place:
        """Place in the file of a fault, without the names that pydantic gives to the branches of a choice."""
        for key in loc:
            here = (*place, key)
            branch = isinstance(key, str) and ("[" in key or key in ("str", "int", "float", "bool"))
            if not branch or here in self._document:
                place = here
        return place

    def one_world(self, section: Any) -> None:
        """Exactly one way to give the world."""
        if isinstance(section, dict):
            ways = list(WorldSection.model_fields)
            given = [name for name in ways if section.get(name) is not None]
            if len(given) != 1 and section.keys() <= set(ways):
                got = " and ".join(given) or "none"
                self.add(("world",), f"give exactly one of {', '.join(ways)}; got {got}")

    def built(self, registry: Registry, spec: Any, place: Place) -> object:
        """An object of a registry from a name, or from one name with its parameters, checked by their types."""
        if not isinstance(spec, str | dict):
            return None  # the file's schema says so
        if len(named := {spec: {}} if isinstance(spec, str) else spec) != 1:
            self.add(place, f"expected one name with its parameters, got {', '.join(named) or 'none'}")
            return None
        ((name, parameters),) = named.items()
        if not isinstance(parameters, dict | None):
            return None
        inside = place if isinstance(spec, str) else (*place, name)
        with self.collected(inside):
            cls = registry[name]
            checked = self.validated(_parameters(cls), parameters or {}, inside)
            if checked is not None:
                return cls(**{key: getattr(checked, key) for key in checked.model_fields_set})
        return None

    def pose(self, given: Any, key: str) -> tuple[Any, ...]:
        """A start or goal, the yaw in rad; a goal's may be free (None)."""
        x, y, yaw = given if isinstance(given, list) and len(given) == 3 else (0.0, 0.0, 0.0)
        if isinstance(yaw, str):
            if key == "goal" and yaw == "any":
                return x, y, None
            match = DEGREES.fullmatch(yaw)
            if not match:
                free = ", or 'any'" if key == "goal" else ""
                self.add((key, 2), f"a yaw is a number in rad, or text such as '90 deg'{free}; got {yaw!r}{_note(yaw)}")
                return x, y, 0.0
            yaw = math.radians(float(match.group(1)))
        return x, y, yaw


def _parameters(cls: Any) -> type[BaseModel]:
    """The schema of a dataclass's fields."""
    try:
        hints = get_type_hints(cls)
    except NameError:  # a plugin that imports names for type checkers only
        hints = {}
    schema: dict[str, Any] = {}
    for field in dataclasses.fields(cls):
        if field.init:
            optional = not (field.default is field.default_factory is dataclasses.MISSING)
            schema[field.name] = (hints.get(field.name, Any), None if optional else ...)
    return create_model(cls.__name__, __config__=PARAMETERS, **schema)


def _said(schema: type[BaseModel], loc: Place, faults: list[Any]) -> str:
    """One line on all that is wrong at one place."""
    fault = next((one for one in faults if one["type"] not in EXPECTED), faults[0])
    got = fault.get("input")
    if fault["type"] == "extra_forbidden":
        known = _keys_at(schema, loc[:-1])
        near = difflib.get_close_matches(str(loc[-1]), known, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else "."
        return f"no such key{hint} Known here: {', '.join(known)}"
    if fault["type"] == "missing":
        return "an entry is missing here" if isinstance(loc[-1], int) else "this key is missing; add it"
    if fault["type"] in ("too_short", "too_long"):
        bound, word = ("min_length", "at least") if fault["type"] == "too_short" else ("max_length", "at most")
        return f"expected {word} {fault['ctx'][bound]} entries, got {fault['ctx']['actual_length']}"
    expected = [EXPECTED[one["type"]] for one in faults if fault["type"] in EXPECTED]
    text = (
        f"expected {' or '.join(dict.fromkeys(expected))}" if expected else fault["msg"][:1].lower() + fault["msg"][1:]
    )
    return f"{text}, got {'nothing' if got is None else repr(got)[:60]}{_note(got)}"


def _note(got: Any) -> str:
    if isinstance(got, str) and re.fullmatch(r"[-+]?\d+(\.\d*)?e[-+]?\d+", got, re.IGNORECASE):
        return f" (YAML reads {got} as text; write it with a point and a sign, such as 1.0e-3)"
    if isinstance(got, bool):
        return " (YAML reads no, off, yes and on as truth values; put words in quotes)"
    return ""


def _keys_at(schema: Any, loc: Place) -> list[str]:
    """Keys that a schema knows at a place."""
    for key in loc:
        annotation = schema.model_fields[key].annotation if isinstance(key, str) else schema
        inner = [a for a in _flat(annotation) if isinstance(a, type) and issubclass(a, BaseModel)]
        schema = inner[0] if inner else schema
    return list(schema.model_fields)


def _flat(annotation: Any) -> list[Any]:
    inside = getattr(annotation, "__args__", ())
    return [leaf for part in inside for leaf in _flat(part)] if inside else [annotation]


def _world(section: WorldSection, folder: Path) -> World:
    """The world of a section; paths are relative to the folder."""
    match next(value for _, value in section if value is not None):
        case RosMap() as given:
            keep_out = None if given.keep_out is None else folder / given.keep_out
            return World.from_ros_map(
                folder / given.path, unknown_is_free=given.unknown_is_free, keep_out=keep_out, height=given.height
            )
        case MovingAI() as given:
            return World.from_movingai(folder / given.path, resolution=given.resolution)
        case GeoJSON() as given:
            return World.from_geojson(
                folder / given.path, scale=given.scale, origin=given.origin, polygons=given.polygons
            )
        case Image() as given:
            return World.from_image(
                folder / given.path,
                given.resolution,
                threshold=given.threshold,
                origin=given.origin,
                height=given.height,
            )
        case given:
            prisms = [(shapely.Polygon(p.corners), p.height or (-math.inf, math.inf)) for p in given.obstacles]
            closed = [shapely.Polygon(corners) for corners in given.keep_out]
            return World.from_polygons(
                prisms,
                extent=None if given.extent is None else shapely.Polygon(given.extent),
                keep_out=shapely.union_all(closed) if closed else None,
            )
