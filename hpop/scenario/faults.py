"""Collection of the faults of a scenario file, which are reported together, each with line, key and fix."""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import shapely
from pydantic import BaseModel, ValidationError

from hpop.base.options import Degrees
from hpop.base.registry import Registry, goals, model_parameters, models, planners, readers
from hpop.base.text import article, shown
from hpop.errors import MOST_LETTERS, OWN, HpopError, QueryError, ScenarioError
from hpop.goals import Tour, TourStop, is_named
from hpop.motions import Model, StateSpace
from hpop.runtime.limits import LIMITS, NO_LIMIT
from hpop.scenario.schema import StopEntry, WorldSection, parameters_of, stop_words
from hpop.scenario.yaml_lines import Document, Place, entries, note_on_path, note_on_yaml
from hpop.world.readers.readers import ENDINGS

OTHER_WORDS = {
    "robot": "model",
    "map": "world",
    "target": "goal",
    "begin": "start",
    "scale": "resolution",
} | dict.fromkeys(("costs", "objectives"), "criteria")
"""For wrong keys that users write, the key that a scenario has."""
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
"""Expected value for each kind of fault that pydantic reports, in words for the user."""
MOST_FAULTS = 20
"""Largest number of faults that one error lists."""
MOST_COMPARED = 500
"""Largest number of faults in one part of a file that are examined, since each is compared with the others."""
T = TypeVar("T")


class Faults:
    """Collector of the faults of a scenario file, so that all are reported together.

    notes  notes (texts to print) on files that the scenario names
    """

    def __init__(self, document: Document) -> None:
        self._document = document
        self._found: list[tuple[int, HpopError]] = []
        self.notes: list[str] = []

    def beside(self, path: str) -> Path:
        """Return a path that the scenario gives, resolved from the scenario's folder."""
        return self._document.path.parent / path

    def add(self, place: Place, text: str, kind: type[HpopError] = ScenarioError) -> None:
        """Add a fault at a position (keys) in the file; ``kind`` is the class of its error."""
        where = self._document.where(place) + stop_words(self._document.values, place, text)
        self._found.append(
            (self._document.line(place), kind(f"{where}: {text}{note_on_path(text, self._document.path)}"))
        )

    def raise_all(self) -> None:
        """Raise all collected faults as one error, in the order of the file; do nothing if there are none.

        The error has the class of the faults if they share one, else it is a ScenarioError.
        """
        if not self._found:
            return
        errors = [error for _, error in sorted(self._found, key=lambda fault: fault[0])]
        kinds = {type(error) for error in errors}
        kind = kinds.pop() if len(kinds) == 1 else ScenarioError
        texts = list(dict.fromkeys(map(str, errors)))
        more = [f"and at least {len(texts) - MOST_FAULTS:,} more faults"] if len(texts) > MOST_FAULTS else []
        raise kind("\n".join([*texts[:MOST_FAULTS], *more]))

    @contextmanager
    def collected(self, place: Place) -> Iterator[None]:
        """Add a fault for an error that hpop, or the constructor of a plugin, raises in the ``with`` block."""
        try:
            yield
        except HpopError as error:
            self.add(place, str(error), type(error))
        except (TypeError, ValueError, shapely.errors.ShapelyError) as error:
            self.add(place, str(error))

    def validated(self, schema: type[BaseModel], values: Any, place: Place) -> Any:
        """Validate values strictly against a schema and return its instance; None after adding a fault per position."""
        try:
            return schema.model_validate_json(json.dumps(values), context={"folder": str(self._document.path.parent)})
        except ValidationError as error:
            details = [(self._place(place, _whole(fault)), fault) for fault in error.errors()[:MOST_COMPARED]]
        places = [where for where, _ in details]
        for where in dict.fromkeys(places):
            below = any(other[: len(where)] == where != other for other in places)
            here = [fault for at, fault in details if at == where]
            if below and all(map(_expected, here)):
                continue  # faults of the alternatives that the user did not mean
            unknown = place[:1] == ("planner",) and here[0]["type"] == "extra_forbidden"
            advice = planners.advice.get(str(where[-1])) if unknown else None
            self.add(where, _said(schema, where[len(place) :], here) + (f"; {advice}" if advice else ""))
        return None

    def _place(self, place: Place, loc: tuple[str | int, ...]) -> Place:
        """Return the position of a fault in the file, without the names of alternatives that pydantic inserts."""
        for key in loc:
            here = (*place, key)
            branch = isinstance(key, str) and (
                "[" in key or key in ("str", "int", "float", "bool") or key[:1].isupper()
            )
            if not branch or here in self._document:
                place = here
        return place

    def one_world(self, section: Any) -> None:
        """Add a fault unless the world section gives exactly one world."""
        if isinstance(section, dict):
            ways = list(WorldSection.model_fields)
            given = [name for name in ways if section.get(name) is not None]
            if len(given) != 1 and section.keys() <= set(ways):
                got = " and ".join(given) or "none"
                self.add(("world",), f"give exactly one of {', '.join(ways)}; got {got}")
            for name in given:
                if isinstance(section[name], str):
                    self.add(("world", name), f"write the file as {{path: {shown(section[name])}}}")
        elif isinstance(section, str):
            reader = ENDINGS.get(Path(section).suffix.lower(), "ros_map")
            self.add(("world",), f"expected a reader with its file: {{{reader}: {{path: {shown(section)}}}}}")

    def no_map(self) -> None:
        """Raise ScenarioError if the file is a map rather than a scenario."""
        given = self._document.values
        world, path = given.get("world"), self._document.path
        maps = {
            "ros_map": "world" not in given and {"image", "resolution"} <= given.keys(),
            "geojson": "world" not in given and "features" in given,
            "moveit_scene": isinstance(world, dict) and "collision_objects" in world,
        }
        for reader in (name for name, is_map in maps.items() if is_map):
            raise ScenarioError(
                f"{path}: this is a map, not a scenario; write a separate YAML file that names it, with "
                f"world: {{{reader}: {{path: {path.name}}}}}, start, goal and criteria"
            )

    def built(self, registry: Registry[type], spec: Any, place: Place) -> object:
        """Create an object of a registry from its name, or from its name with parameters, which are checked by type.

        Returns None after adding a fault.
        """
        if not isinstance(spec, str | dict):
            return None  # the file's schema reports it
        if len(named := {spec: {}} if isinstance(spec, str) else spec) != 1:
            several = "; several planners are written as a list, each with a dash"
            got = (", ".join(named) or "none") + several * bool(named and place[0] == "planner")
            self.add(place, f"expected one name with its parameters, got {got}")
            return None
        ((name, parameters),) = named.items()
        if not isinstance(parameters, dict | None):
            return None
        inside = place if isinstance(spec, str) else (*place, name)
        with self.collected(inside):
            cls, given = registry[name], parameters or {}
            parts = model_parameters(cls) & given.keys()
            made = {key: self.built(models, given[key], (*inside, key)) for key in parts}
            checked = self.validated(parameters_of(cls), given, inside)
            if checked is not None and None not in made.values():
                return cls(**{key: getattr(checked, key) for key in checked.model_fields_set} | made)
        return None

    def state(self, given: Any, place: Place, space: StateSpace | None) -> dict[str, Any] | None:
        """Return a start or goal as values by name, with angles in rad and free angles None.

        After adding a fault of one value, this value is 0; after a fault of the whole state, the result is None.
        Without a space (``space`` is None because the model is faulty), only angles are checked, and the result is
        None.
        """
        what = str(place[0])
        if space is None:
            for i, value in enumerate(entries(given)):
                if isinstance(value, str) and value != "any":
                    self.angle(value, (*place, i), "an angle")
            return None
        if isinstance(given, str) and (space.named or space.unnamed):
            with self.collected(place):
                called = space.called(given, what)
                space.state(called, free=space.angles, what=what)  # refused here, where the name is given
                return space.by_name(called, what)
            return None
        given = space.completed(given, what)
        by_name = isinstance(given, dict)
        keys: dict[str, str | int] = {name: name if by_name else i for i, name in enumerate(space.names)}
        values = given if by_name else dict(enumerate(entries(given)))
        if values.keys() == set(keys.values()) and all(_may_be(values[keys[n]], n in space.angles) for n in keys):
            return {name: self._column(values[key], (*place, key), space, name) for name, key in keys.items()}
        got = "nothing" if given is None else shown(given, 60)
        misfit = space.misfit(given) if by_name else ""
        if isinstance(given, list) and len(given) != len(space.names):
            misfit = f"{len(given)} values for {len(space.names)} states"
        note = note_on_yaml([value for value in values.values() if Degrees.in_radians(value) == value])
        self.add(place, f"expected {_form(space, what)}, got {got}{note}{f'; {misfit}' * bool(misfit)}")
        return None

    def _column(self, value: Any, place: Place, space: StateSpace, name: str) -> Any:
        """Check one value of a state, such as x or yaw, at the start or a goal, and return it, angles in rad.

        At a goal, "any" becomes None. After adding a fault, return 0.
        """
        what = str(place[0])
        turns = name in space.angles
        if value == "any":
            if what == "goal":
                return None
            self.add(
                place, f"the {name} at the start must be in rad, or text such as '0 deg'; only goals may have 'any'"
            )
            return 0.0
        angle = self.angle(value, place, article(name), ", or 'any'" if what == "goal" else "") if turns else value
        with self.collected(place):
            return space.checked(name, angle, what, article(name) if turns else "")
        return 0.0

    def goal(self, given: Any, place: Place, model: Model | None) -> Any:
        """Check and build a goal, or a list of alternative goals."""
        speaks = model is not None and (model.space.named or model.space.unnamed)
        kinds = (list, dict, str) if speaks else (list, dict)
        if isinstance(given, list) and given and all(isinstance(entry, kinds) for entry in given):
            return [self._one_goal(entry, (*place, i), model) for i, entry in enumerate(given)]
        return self._one_goal(given, place, model)

    def _one_goal(self, given: Any, place: Place, model: Model | None) -> Any:
        """Check and build one goal: a state, or a registered goal by name with its parameters."""
        if not is_named(given) and not (isinstance(given, str) and given in goals):
            return self.state(given, place, None if model is None else model.space)
        ((name, parameters),) = given.items() if isinstance(given, dict) else [(given, None)]
        inside = (*place, name) if isinstance(given, dict) else place
        if not isinstance(parameters, dict | None):
            self.add(inside, f"expected the parameters of this goal by name, got {shown(parameters, 60)}")
        made: Any = self.built(goals, given, place)
        if model is not None and made is not None and (absent := sorted(made.requires - model.provides)):
            self.add(inside, f"this goal requires {', '.join(absent)}, which the model does not have", QueryError)
        elif model is not None and made is not None:
            with self.collected(inside):
                made.reached(model, model.space.sample(0, 1))  # a goal that no state can reach says so
        return made

    def tour(self, given: Any, place: Place, model: Model | None) -> Tour | None:
        """Build a tour; None if there is none, or after adding a fault."""
        if not isinstance(given, dict):
            return None  # the file's schema reports it
        stops = [self._stop(entry, (*place, "stops", i), model) for i, entry in enumerate(entries(given.get("stops")))]
        listed = [stop for stop in stops if stop is not None]
        if len(listed) < len(stops) or not stops:
            return None
        order, tour = {key: given[key] for key in ("order", "some") if key in given}, None
        with self.collected((*place, "stops")):
            tour = Tour(tuple(listed))
        with self.collected((*place, *[*order][-1:])):
            return tour and Tour.of({**order, "stops": listed})
        return None

    def _stop(self, given: Any, place: Place, model: Model | None) -> TourStop | None:
        """Build a stop of a tour; None after adding a fault."""
        named = [key for key in given if key in goals] if isinstance(given, dict) else []
        own = {key: value for key, value in given.items() if key not in named} if isinstance(given, dict) else given
        checked = self.validated(StopEntry, own, place)
        made = [self._one_goal({key: given[key]}, place, model) for key in named]
        if checked is None or None in made:
            return None
        with self.collected(place):
            if len(made) > 1:
                raise QueryError(f"a stop must have one goal, got {' and '.join(named)}")
            return TourStop(goal=made[0] if made else None, **{key: getattr(checked, key) for key in own})
        return None

    def angle(self, given: Any, place: Place, what: str, otherwise: str = "") -> Any:
        """Return an angle in rad, given as a number or as text in degrees; for other text add a fault, return 0.

        The fault names the angle as ``what``, and other accepted values by ``otherwise``.
        """
        angle = Degrees.in_radians(given)
        if not isinstance(angle, str):
            return angle
        self.add(
            place,
            f"{what} is a number in rad, or text such as '90 deg'{otherwise}; got {shown(given)}{note_on_yaml(given)}",
        )
        return 0.0

    def made(
        self, given: Any, within: Place, schema: type[BaseModel], make: Callable[[Any, Place], T]
    ) -> list[T | None]:
        """Build a value from each entry of a list, by ``make``; None for an entry with a fault."""
        things: list[T | None] = []
        for place, entry in (((*within, i), entry) for i, entry in enumerate(entries(given))):
            things.append(None)
            checked = self.validated(schema, entry, place) if isinstance(entry, dict) else None
            if checked is not None:
                with self.collected(place):
                    things[-1] = make(checked, place)
        return things


def _may_be(value: Any, angle: bool) -> bool:
    """Return whether a value may be a coordinate of a state: a finite number, or with ``angle`` also a text."""
    number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < math.inf
    return number or (angle and isinstance(value, str))


def _form(space: StateSpace, what: str) -> str:
    """Describe how a start or goal must be written, for an error message."""
    *units, last = dict.fromkeys(space.units) if len(set(space.units)) == 1 else space.units
    angle = next((name for name in space.names if name in space.angles), "")
    degrees = f" (or {article(angle)} such as 90 deg{', or any' * (what == 'goal')})" * bool(angle)
    named = f", or the name of one ({', '.join(space.named)})" * bool(space.named)
    return f"[{', '.join(space.names)}], numbers in {', '.join(units)}{' and ' * bool(units)}{last}{degrees}{named}"


def _said(schema: type[BaseModel], loc: Place, faults: list[Any]) -> str:
    """Describe all faults at one position of the file in one line."""
    fault = next((one for one in faults if not _expected(one)), faults[0])
    got = fault.get("input")
    if fault["type"] == "extra_forbidden":
        known, way_out = [*_schema_at(schema, loc[:-1]).model_fields, *(goals if schema is StopEntry else ())], ""
        if loc[:-1] == ("world",):
            if loc[-1] in readers:
                return "no such key beside another; give exactly one reader"
            known += [name for name in readers if name not in known]
            way_out = f". For a reader of your own, {OWN}"
        near = difflib.get_close_matches(str(loc[-1])[:MOST_LETTERS], known, n=1)
        near = [word for word in (OTHER_WORDS.get(str(loc[-1])), *near) if word in known][:1]
        hint = f"; did you mean {near[0]!r}?" if near else "."
        return f"no such key{hint} Known here: {', '.join(known)}{way_out}"
    if fault["type"] == "missing":
        if not isinstance(fault["loc"][-1], int):
            return "this key is missing; add it"
        wanted = 1 + max(one["loc"][-1] for one in faults if isinstance(one["loc"][-1], int))
        return f"expected {wanted} entries, got {shown(got, 60)}"
    if fault["type"] in ("too_short", "too_long"):
        bound, word = ("min_length", "at least") if fault["type"] == "too_short" else ("max_length", "at most")
        wanted = fault["ctx"][bound]
        return f"expected {word} {wanted} {'entry' if wanted == 1 else 'entries'}, got {fault['ctx']['actual_length']}"
    limit = LIMITS.get(str(loc[-1])) if loc else None
    expected = [_expected(one) for one in faults if _expected(fault)]
    if (numbers := _numbers_at(schema, loc)) and EXPECTED["tuple_type"] in expected:
        expected[expected.index(EXPECTED["tuple_type"])] = f"a list of {numbers} numbers"
    text = (
        f"expected {' or '.join(dict.fromkeys(expected))}" if expected else fault["msg"][:1].lower() + fault["msg"][1:]
    )
    text, hint = (f"{text} of {limit}", f"; {NO_LIMIT}") if limit else (text, "")
    if isinstance(got, list) and loc and f"{loc[-1]}s" in _schema_at(schema, loc[:-1]).model_fields:
        hint = f"; to list several, write {loc[-1]}s"
    return f"{text}, got {'nothing' if got is None else shown(got, 60)}{note_on_yaml(got)}{hint}"


def _whole(fault: Any) -> tuple[str | int, ...]:
    """Return the position at which a fault is reported. An entry missing from a short list is a fault of the list."""
    loc: tuple[str | int, ...] = fault["loc"]
    return loc[:-1] if fault["type"] == "missing" and isinstance(loc[-1], int) else loc


def _expected(fault: Any) -> str:
    """Return in plain words what a fault of pydantic expected; "" if pydantic's own message says it."""
    return str(fault["ctx"]["expected"]) if fault["type"] == "literal_error" else EXPECTED.get(fault["type"], "")


def _schema_at(schema: Any, loc: Place) -> Any:
    """Return the pydantic schema of the values at a position in the file."""
    for key in loc:
        annotation = getattr(schema.model_fields.get(key), "annotation", None) if isinstance(key, str) else schema
        inner = [a for a in _flat(annotation) if isinstance(a, type) and issubclass(a, BaseModel)]
        schema = inner[0] if inner else schema
    return schema


def _numbers_at(schema: Any, loc: Place) -> int:
    """Return how many numbers are expected at a position in the file; 0 for other values, or any number of numbers."""
    field = _schema_at(schema, loc[:-1]).model_fields.get(loc[-1]) if loc else None
    annotation = getattr(field, "annotation", None)
    for form in (annotation, *getattr(annotation, "__args__", ())):
        if getattr(form, "__origin__", None) is tuple and set(_flat(form)) <= {float, str}:
            return len(form.__args__)
    return 0


def _flat(annotation: Any) -> list[Any]:
    """Return the plain types inside a type annotation."""
    inside = getattr(annotation, "__args__", ())
    return [leaf for part in inside for leaf in _flat(part)] if inside else [annotation]
