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
from pathlib import Path
from typing import Any, Literal, cast, get_type_hints

import shapely
from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from hpop.criteria.base import Criterion
from hpop.errors import HpopError, ScenarioError, UnknownName
from hpop.models import DifferentialDrive
from hpop.planners.base import Planner
from hpop.problem import Problem
from hpop.registry import Registry, criteria, models, planners
from hpop.world import World
from hpop.yaml_lines import Document, Place

STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
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
    model: Named = {"differential_drive": {}}
    start: tuple[float, float, float | str]
    goal: tuple[float, float, float | str]
    criteria: list[str | Named] = Field(min_length=1)
    planner: str | Named | list[str | Named] = "lattice"


@dataclasses.dataclass(frozen=True, eq=False)
class Scenario:
    """What a scenario file asks for."""

    problem: Problem
    planners: tuple[Planner, ...]
    path: Path


def load_scenario(path: str | Path) -> Scenario:
    """Read, check and build a scenario.

    Raises ScenarioError for the file's form (all faults at once, each with key, line and fix), UnknownName, MapError,
    ModelError, CriterionError, OptionError or QueryError for what the parts say, with the line put in front.
    """
    document = Document(Path(path))
    file = _validated(ScenarioFile, document, document.values, ())
    sections = [name for name, value in file.world if value is not None]
    if len(sections) != 1:
        choices = ", ".join(WorldSection.model_fields)
        raise ScenarioError(f"{document.where(('world',))}: give exactly one of {choices}; got {sections or 'none'}")
    model = cast(DifferentialDrive, _built(models, file.model, document, ("model",)))
    wanted = [
        cast(Criterion, _built(criteria, spec, document, ("criteria", i))) for i, spec in enumerate(file.criteria)
    ]
    several = file.planner if isinstance(file.planner, list) else [file.planner]
    places: list[Place] = [("planner", i) if isinstance(file.planner, list) else ("planner",) for i in range(len(several))]
    chosen = tuple(
        cast(Planner, _built(planners, spec, document, place)) for spec, place in zip(several, places, strict=True)
    )
    start = (*file.start[:2], _yaw(file.start[2], document, "start"))
    goal = (*file.goal[:2], None if file.goal[2] == "any" else _yaw(file.goal[2], document, "goal"))
    world = _world(file.world, document)
    with _Located(document, ("criteria",)):
        problem = Problem(world, model, start, goal, wanted)
    return Scenario(problem, chosen, document.path)


class _Located:
    """Put file, line and key in front of the message of any error of hpop raised inside."""

    def __init__(self, document: Document, place: Place) -> None:
        self._where = document.where(place)

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, HpopError):
            raise type(error)(f"{self._where}: {error}") from None
        if isinstance(error, TypeError | ValueError):
            raise ScenarioError(f"{self._where}: {error}") from None


def _validated(schema: type[Any], document: Document, values: Any, place: Place) -> Any:
    """Check values against a schema, strictly; one line a fault, each with file, line and key."""
    try:
        return schema.model_validate_json(json.dumps(values, default=str))
    except ValidationError as error:
        faults = [_fault(schema, document, place, dict(fault)) for fault in error.errors()]
        raise ScenarioError("\n".join(dict.fromkeys(faults))) from None


def _fault(schema: type[BaseModel], document: Document, place: Place, fault: dict[str, Any]) -> str:
    loc = tuple(key for key in fault["loc"] if not (isinstance(key, str) and ("[" in key or key in ("str", "float"))))
    where = document.where((*place, *loc))
    got = fault.get("input")
    if fault["type"] == "extra_forbidden":
        known = _keys_at(schema, loc[:-1])
        near = difflib.get_close_matches(str(loc[-1]), known, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        return f"{where}: no such key; {hint}Known here: {', '.join(known)}"
    if fault["type"] == "missing":
        return f"{where}: this key is missing; add it"
    text = fault["msg"][0].lower() + fault["msg"][1:]
    note = ""
    if isinstance(got, str) and re.fullmatch(r"[-+]?\d+(\.\d*)?e[-+]?\d+", got, re.IGNORECASE):
        note = f" (YAML reads {got} as text; write it with a point and a sign, such as 1.0e-3)"
    elif isinstance(got, bool):
        note = " (YAML reads no, off, yes and on as truth values; put words in quotes)"
    return f"{where}: {text}, got {str(got)[:60]!r}{note}"


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


def _built(registry: Registry, spec: str | Named, document: Document, place: Place) -> object:
    """An object of a registry from a name, or from one name with its parameters, which are checked by their types."""
    named: Named = {spec: {}} if isinstance(spec, str) else spec
    if len(named) != 1:
        raise ScenarioError(
            f"{document.where(place)}: expected one name with its parameters, got {len(named)}: {', '.join(named)}"
        )
    ((name, parameters),) = named.items()
    try:
        cls = registry[name]
    except UnknownName as error:
        raise UnknownName(f"{document.where(place)}: {error}") from None
    inside = place if isinstance(spec, str) else (*place, name)
    hints = get_type_hints(cls)
    fields = {f.name: (hints[f.name], f.default) for f in dataclasses.fields(cls) if f.init}
    missing = dataclasses.MISSING
    schema = create_model(  # type: ignore[call-overload]
        name, __config__=STRICT, **{key: (hint, ... if d is missing else d) for key, (hint, d) in fields.items()}
    )
    checked = _validated(schema, document, parameters or {}, inside)
    with _Located(document, inside):
        return cls(**{key: getattr(checked, key) for key in checked.model_fields_set})


def _yaw(value: float | str, document: Document, key: str) -> float:
    if not isinstance(value, str):
        return value
    match = DEGREES.fullmatch(value)
    if not match:
        free = ", or 'any'" if key == "goal" else ""
        raise ScenarioError(
            f"{document.where((key, 2))}: a yaw is a number in rad, or text such as '90 deg'{free}; got {value!r}"
        )
    return math.radians(float(match.group(1)))


def _world(section: WorldSection, document: Document) -> World:
    folder = document.path.parent

    def there(path: str) -> Path:
        return folder / path

    key, given = next((name, value) for name, value in section if value is not None)
    with _Located(document, ("world", key)):
        match given:
            case RosMap():
                keep_out = None if given.keep_out is None else there(given.keep_out)
                return World.from_ros_map(
                    there(given.path), unknown_is_free=given.unknown_is_free, keep_out=keep_out, height=given.height
                )
            case MovingAI():
                return World.from_movingai(there(given.path), resolution=given.resolution)
            case GeoJSON():
                return World.from_geojson(
                    there(given.path), scale=given.scale, origin=given.origin, polygons=given.polygons
                )
            case Image():
                return World.from_image(
                    there(given.path),
                    given.resolution,
                    threshold=given.threshold,
                    origin=given.origin,
                    height=given.height,
                )
            case _:
                prisms = [
                    (shapely.Polygon(p.corners), p.height or (-math.inf, math.inf)) for p in given.obstacles
                ]
                return World.from_polygons(
                    prisms,
                    extent=None if given.extent is None else shapely.Polygon(given.extent),
                    keep_out=shapely.union_all([shapely.Polygon(corners) for corners in given.keep_out])
                    if given.keep_out
                    else None,
                )
