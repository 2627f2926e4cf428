"""JSON schema of scenario files, which lets editors complete and check them.

It lists everything registered, with options and their descriptions from docstrings. It follows draft 7, which editors
support. Conditions that no schema can express, such as a free start, are checked by `hpop look` and `hpop plan`.
"""

from __future__ import annotations

import dataclasses
import inspect
import json
import re
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, cast

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import PydanticOmit, core_schema

from hpop.base.options import Degrees
from hpop.base.registry import (
    Registry,
    criteria,
    goals,
    model_parameters,
    models,
    planners,
    readers,
    required_parameters,
)
from hpop.goals import TourStop
from hpop.scenario.schema import (
    DEFAULT_MODEL,
    DEFAULT_PLANNER,
    Choose,
    ContentFile,
    CylinderSize,
    FieldEntry,
    FutureEntry,
    LandmarkEntry,
    MapFile,
    PersonEntry,
    PrismEntry,
    ScenarioFile,
    SolidEntry,
    StopEntry,
    TourSection,
    TrackEntry,
    WaypointsEntry,
    WorldSection,
    ZoneEntry,
    parameters_of,
)
from hpop.world.content.content import Landmark, Person, Zone

TABLE = re.compile(r"^(\w+(?:, \w+)*) {2,}(\S.*)$")
NUMPY = re.compile(r"^(\w+(?:, \w+)*) : (.+)$")


def parameter_docs(item: type | Callable[..., Any]) -> dict[str, str]:
    r"""Return the descriptions of the parameters of a class (with its bases) or of a function, by name.

    Three forms are recognised: aligned lines in the docstring (``radius  m  of a round footprint``), comments behind
    the fields (``radius: float = 2.0  # m``), and NumPy's sections (``scale : float`` and indented lines).

    >>> def read(path, scale):
    ...     "path : path of the file\n    scale : float\n        Metres a unit."
    >>> parameter_docs(read)
    {'path': 'path of the file', 'scale': 'Metres a unit.'}
    """
    found: dict[str, str] = {}
    for one in reversed(item.__mro__) if isinstance(item, type) else (item,):
        if one.__module__.partition(".")[0] == "builtins":
            continue
        found |= _comments(one) if isinstance(one, type) else {}
        found |= _lines(inspect.cleandoc(one.__doc__ or ""))
    return found


def _lines(text: str) -> dict[str, str]:
    """Return the descriptions in a docstring by parameter name; indented lines below a description belong to it."""
    found: dict[str, list[str]] = {}
    names: list[str] = []
    typed: set[str] = set()
    for line in text.split("\n"):
        table, numpy = TABLE.match(line), NUMPY.match(line)
        if match := table or numpy:
            names = match.group(1).split(", ")
            found |= {name: [match.group(2)] for name in names}
            typed = typed - set(names) if table else typed | set(names)
        elif names and line.startswith("    "):
            for name in names:
                found[name].append(line.strip())
        else:
            names = []
    return {name: _plain_text(lines, typed=name in typed) for name, lines in found.items()}


def _plain_text(lines: list[str], *, typed: bool) -> str:
    """Join the lines of a description to plain text without markup; drop a type in the first line if a text follows.

    >>> _plain_text(["m  radius of the ball", "round the camera"], typed=False)
    'm, radius of the ball round the camera'
    >>> _plain_text(["(x, y), optional", "Point in the room, m."], typed=True)
    '(x, y): Point in the room, m.'
    """
    first, *rest = [re.sub(r"^(\S+) {2,}", r"\1, ", line) for line in lines]
    if typed and rest and (columns := re.fullmatch(r"(\([^()]*\))[\w, ]*", first)):
        first = f"{columns[1]}:"
    is_type = typed and rest and re.fullmatch(r"[\w\[\]|,. ]+|\".*", first)
    text = " ".join(" ".join(rest if is_type else [first, *rest]).split())
    return re.sub(r":\w+:`~?([^`]+)`|``([^`]+)``", r"\1\2", text)


@cache
def _comments(cls: type) -> dict[str, str]:
    """Return the comments behind the fields in the source of a class, by field name."""
    try:
        source = inspect.getsource(cls)
    except (OSError, TypeError):
        return {}
    found = re.findall(r"^ +(\w+): [^#\n]*  # (.+)$", source, re.MULTILINE)
    return {name: text for name, text in found if not text.startswith(("type:", "noqa"))}


Schema = dict[str, Any]

DRAFT = "http://json-schema.org/draft-07/schema#"
LINE = "# yaml-language-server: $schema={}"
"""First line of a scenario, which tells editors where its schema is."""
SHAPES = ("box", "cylinder", "sphere", "hull")
ENTRIES: dict[str, tuple[tuple[type[BaseModel], ...], type]] = {
    "people": ((PersonEntry, WaypointsEntry, TrackEntry), Person),
    "landmarks": ((LandmarkEntry,), Landmark),
    "zones": ((ZoneEntry,), Zone),
    "fields": ((FieldEntry,), FieldEntry),
}
"""Lists in a scenario: the possible forms of their entries, and the class whose docstring describes the keys."""
ONE_KEY: Schema = {"type": "object", "minProperties": 1, "maxProperties": 1, "additionalProperties": False}
ANGLE: Schema = {"anyOf": [{"type": "number"}, Degrees.json_schema()]}
FREE: Schema = {"anyOf": [*ANGLE["anyOf"], {"const": "any"}]}
KEYS = {
    "world": "the map: exactly one reader with its file and options, or polygons or solids written out",
    "model": "the robot: a name, or one name with its parameters (`hpop models`)",
    "view": "what the viewer sees of a 360-degree camera: turned back wholly or to a level horizon, and restricted",
    "start": "a state of the robot: of a base [x m, y m, yaw rad], the yaw also as '90 deg'; or by name, {x: 1, ...}",
    "goal": "a state, whose angles may be 'any'; or a goal such as look_at (`hpop goals`); or a list of alternatives",
    "criteria": "costs to minimise, all at once: names, or names with parameters (`hpop criteria`)",
    "quanta": "smallest differences that count, in the costs' units, by criterion; others keep their own quantum",
    "planner": "how to plan: a name, one name with its options, or a list of several (`hpop planners`)",
    "horizon": "time up to which people are predicted, s; recorded tracks are not cut",
    "people": "people who stand, walk, may do several things, or were recorded: m, m/s, s",
    "groups": "people who talk with each other: names, or indices in the list of people, from 0",
    "landmarks": "points that are worth seeing, m",
    "zones": "areas with a rule, m",
    "fields": "quantities that were measured over the floor, such as the strength of a radio signal",
    "tour": "stops to visit on the way to the goal: positions, goals or landmarks",
    "choose": "a person's preference, written by `hpop prefer`: the best trajectory for this person is marked",
}


def scenario_schema(*, at_home: bool = False) -> Schema:
    """Return the JSON schema of scenario files.

    Parameters
    ----------
    at_home : leave out everything that is not part of hpop: plugins, and types registered by the user's code
    """

    def choice(registry: Registry[type]) -> Schema:
        kept = {name: cls for name, cls in registry.items() if not at_home or cls.__module__.startswith("hpop.")}
        return _choice(registry.kind, kept)

    definitions = {
        "criterion": choice(criteria),
        "planner": choice(planners),
        "model": choice(models),
        "goal": _named({name: cls for name, cls in goals.items() if not at_home or cls.__module__.startswith("hpop.")}),
        "world": _world(at_home=at_home),
        **{key: _entry(forms, said) for key, (forms, said) in ENTRIES.items()},
    }
    keys = cast(Schema, _form(ScenarioFile)["properties"])
    keys |= {key: {"type": "array", "items": _of(key)} for key in ENTRIES}
    goal = [_state(FREE), _of("goal")]
    view = _named({"view": models["view"]})["properties"]["view"]
    (form,) = (one for one in view.get("anyOf", [view]) if "properties" in one)
    keys |= {
        "world": _of("world"),
        "choose": _described(_form(Choose), parameter_docs(Choose)),
        "tour": _tour(at_home=at_home),
        "model": _of("model") | {"default": DEFAULT_MODEL},
        "view": {**form, "properties": {key: one for key, one in form["properties"].items() if key != "model"}},
        "start": _state(ANGLE),
        "goal": {"anyOf": [*goal, {"type": "array", "minItems": 1, "items": {"anyOf": goal}}]},
        "criteria": {"type": "array", "minItems": 1, "items": _of("criterion")},
        "planner": {"anyOf": [_of("planner"), {"type": "array", "minItems": 1, "items": _of("planner")}]}
        | {"default": DEFAULT_PLANNER},
    }  # fmt: skip
    return {
        "$schema": DRAFT,
        "title": "Scenario of hpop",
        "type": "object",
        "required": ["world", "start", "goal", "criteria"],
        "additionalProperties": False,
        "properties": {key: {**keys[key], "description": said} for key, said in KEYS.items()},
        "definitions": definitions,
    }


def _tour(*, at_home: bool) -> Schema:
    """Return the schema of a tour. A stop may have one registered goal by name, besides its own keys."""
    tour = _described(_form(TourSection), parameter_docs(TourSection))
    stop = _described(_form(StopEntry), parameter_docs(StopEntry) | parameter_docs(TourStop))
    named = {name: cls for name, cls in goals.items() if not at_home or cls.__module__.startswith("hpop.")}
    stop["properties"] |= _named(named)["properties"]
    tour["properties"]["stops"] |= {"items": stop}
    return tour


def written(schema: Schema) -> str:
    """Return a schema as the text of a JSON file."""
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


class _Generator(GenerateJsonSchema):
    """Schema generator of pydantic that leaves out types which a YAML file cannot hold."""

    def dataclass_schema(self, schema: core_schema.DataclassSchema) -> Schema:
        raise PydanticOmit

    def definitions_schema(self, schema: core_schema.DefinitionsSchema) -> Schema:
        self._omitted = {one["ref"] for one in schema["definitions"] if one["type"] == "dataclass"}
        kept = [one for one in schema["definitions"] if one["type"] != "dataclass"]
        return super().definitions_schema({**schema, "definitions": kept})

    def definition_ref_schema(self, schema: core_schema.DefinitionReferenceSchema) -> Schema:
        if schema["schema_ref"] in self._omitted:
            raise PydanticOmit
        return super().definition_ref_schema(schema)

    def handle_invalid_for_json_schema(self, schema: Any, error_info: str) -> Schema:
        return {}


def _form(model: type[BaseModel]) -> Schema:
    """Return the JSON schema of a pydantic model, in draft 7, without references."""
    made = model.model_json_schema(schema_generator=_Generator)
    return cast(Schema, _plain(made, made.pop("$defs", {})))


def _plain(schema: Any, definitions: Schema) -> Any:
    """Remove titles, references and null defaults from a schema; tuples become arrays of draft 7."""
    if isinstance(schema, list):
        return [_plain(one, definitions) for one in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        return _plain(definitions[schema["$ref"].rpartition("/")[2]], definitions)
    found = {
        key: {name: _plain(one, definitions) for name, one in value.items()}
        if key == "properties"
        else _plain(value, definitions)
        for key, value in schema.items()
        if not (key == "title" and isinstance(value, str)) and not (key == "default" and value is None)
    }
    if "prefixItems" in found:
        found["items"] = found.pop("prefixItems")
    return found


def _described(schema: Schema, docs: dict[str, str], defaults: Schema | None = None) -> Schema:
    """Add descriptions and defaults to the properties of a schema, in place; return this schema."""
    for name, one in schema.get("properties", {}).items():
        if docs.get(name):
            one["description"] = docs[name]
        if defaults and name in defaults:
            one["default"] = defaults[name]
    return schema


def _entry(forms: Sequence[type[BaseModel]], said: type) -> Schema:
    """Return the schema of an entry in a list, which may have one of several forms.

    The docstrings of the form and of ``said`` (the class that the entry becomes) describe its keys.
    """
    made = [_described(_form(form), parameter_docs(said) | parameter_docs(form)) for form in forms]
    for one in made:
        if future := one["properties"].get("futures"):
            _described(future["items"], parameter_docs(FutureEntry))
    return made[0] if len(made) == 1 else {"anyOf": made}


def _parameters(cls: Any) -> Schema:
    """Return the schema of the parameters of a registered class."""
    schema = _form(parameters_of(cls))
    for name in model_parameters(cls):
        schema["properties"][name] = _of("model")
    return _described(schema, parameter_docs(cls), _defaults(cls))


def _defaults(cls: Any) -> Schema:
    """Return the default values of a class's parameters, as far as JSON can express them."""
    found = {}
    for field in dataclasses.fields(cls):
        if field.init and field.default is not dataclasses.MISSING and field.default is not None:
            with_json = _jsonable(field.default)
            if with_json is not None:
                found[field.name] = with_json
    return found


def _jsonable(value: Any) -> Any:
    """Return a value as JSON would read it back; None if JSON cannot express it."""
    try:
        return json.loads(json.dumps(value, allow_nan=False))
    except (TypeError, ValueError):
        return None


def _named(types: dict[str, Any]) -> Schema:
    """Return the schema of a mapping with one key: the name of a registered class, with its parameters."""
    properties = {}
    for name, cls in types.items():
        parameters = _parameters(cls)
        bare = [] if required_parameters(cls) else [{"type": "null"}]
        properties[name] = {"anyOf": [parameters, *bare], "description": summary(cls)}
    return {**ONE_KEY, "properties": properties}


def _choice(kind: str, types: dict[str, Any]) -> Schema:
    """Return the schema of a choice among registered classes: a name, or a name with parameters."""
    names = [
        {"const": name, "description": summary(cls)} for name, cls in types.items() if not required_parameters(cls)
    ]
    return {"anyOf": [*names, _named(types)], "description": f"a {kind}"}


def summary(item: Any) -> str:
    """Return the first paragraph of a registered class's docstring; for a criterion with unit, aggregate and group."""
    first = " ".join((item.__doc__ or "").strip().split("\n\n")[0].split()).replace("``", "")
    if not hasattr(item, "aggregate"):
        return first
    unit = "" if item.unit == "1" else f"{item.unit}, "
    return f"{first} ({unit}{item.aggregate}, group {item.group})"


def _world(*, at_home: bool) -> Schema:
    """Return the schema of the world section: one key, a reader or a kind of obstacles, with its options.

    With ``at_home``, readers of installed plugin packages are left out.
    """
    ways: Schema = {}
    for name, field in WorldSection.model_fields.items():
        form = next(one for one in field.annotation.__args__ if one is not type(None))  # type: ignore[union-attr]
        ways[name] = _form(form) | {"description": " ".join((form.__doc__ or "").replace("``", "").split())}
        if issubclass(form, MapFile):
            _described(ways[name], parameter_docs(form) | parameter_docs(readers[name]))
        else:
            _described(ways[name], parameter_docs(form))
    for role in ("landmarks", "flows", "zones"):
        _, alone, several = ways["geojson"]["properties"][role]["anyOf"]
        for file in (alone, several["items"]["anyOf"][1]):
            _described(file, parameter_docs(ContentFile))
    _described(ways["polygons"]["properties"]["obstacles"]["items"], parameter_docs(PrismEntry))
    ways["solids"]["properties"]["obstacles"]["items"] = _solid()
    if not at_home:
        for name in readers.keys() - ways.keys():
            path = {"type": "string", "description": "file, relative to the scenario"}
            ways[name] = {"type": "object", "required": ["path"], "properties": {"path": path}}
    return {**ONE_KEY, "properties": ways}


def _solid() -> Schema:
    """Return the schema of a solid, which has exactly one shape and at most one rotation."""
    solid = _described(_form(SolidEntry), parameter_docs(SolidEntry))
    _described(solid["properties"]["cylinder"]["anyOf"][0], parameter_docs(CylinderSize))
    turned = {"not": {"required": ["rpy", "quaternion"]}}
    return solid | {"oneOf": [{"required": [shape]} for shape in SHAPES], **turned}


def _state(angle: Schema) -> Schema:
    """Return the schema of a robot's state: a list of values, a mapping from names to values, or a state's name."""
    return {
        "anyOf": [
            {"type": "array", "minItems": 1, "items": angle},
            {"type": "object", "minProperties": 1, "additionalProperties": angle},
            {"type": "string"},
        ]
    }


def _of(name: str) -> Schema:
    """Return a reference to a definition of the schema."""
    return {"$ref": f"#/definitions/{name}"}
