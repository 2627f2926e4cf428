"""Whatever stands in the place of an argument of a public function or method, the error names the argument."""

from __future__ import annotations

import importlib
import inspect
import math
import os
import re
import resource
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hpop
from hpop.base.arguments import checked_arguments
from hpop.errors import HpopError
from hpop.frontier.points import FrontError
from hpop.study.statistics import bradley_terry
from hpop.testing import random_motions
from hpop.view import save_pictures
from hpop.world.geometry.solids import Box, pose_at
from tests.right_values import Right, right_values

PACKAGES = [
    "hpop",
    "hpop.batches",
    "hpop.criteria",
    "hpop.drive",
    "hpop.export",
    "hpop.frontier",
    "hpop.goals",
    "hpop.models",
    "hpop.models.base",
    "hpop.models.driven",
    "hpop.motions",
    "hpop.planners",
    "hpop.preference",
    "hpop.ros",
    "hpop.search",
    "hpop.search.timed",
    "hpop.study",
    "hpop.study.statistics",
    "hpop.testing",
    "hpop.view",
    "hpop.world",
    "hpop.world.content.content",
]
RESULTS = [
    "hpop.drive.Change",
    "hpop.drive.Commit",
    "hpop.drive.Event",
    "hpop.drive.Happening",
    "hpop.drive.Moment",
    "hpop.drive.Option",
    "hpop.drive.Options",
    "hpop.drive.Wish",
    "hpop.frontier.ItemPoint",
    "hpop.search.MeanPaths",
    "hpop.search.ParetoPaths",
    "hpop.search.SupportedPaths",
    "hpop.search.SearchStats",
    "hpop.search.timed.TimedPaths",
    "hpop.preference.Best",
    "hpop.preference.Preference",
    "hpop.study.Analysis",
    "hpop.study.Condition",
    "hpop.study.Fitted",
    "hpop.study.Power",
    "hpop.study.statistics.Strengths",
    "hpop.motions.Body",
    "hpop.motions.Instants",
    "hpop.planners.Candidates",
    "hpop.study.Design",
    "hpop.batches.PlannerSummary",
]
"""Classes that hpop makes and nobody else: their constructors check nothing, their methods do."""
LONG = [
    "hpop.batch",
    "hpop.batches.batch",
    "hpop.Problem.solve",
    "hpop.Problem.fronts",
    "hpop.Planning.solve",
    "hpop.Planning.front",
    "hpop.ros.Bridge.run",
    "hpop.study.prepare",
    "hpop.study.simulate",
    "hpop.study.power",
    "hpop.testing.conformance",
    "hpop.testing.check_criterion",
    "hpop.testing.check_model",
    "hpop.testing.check_planner",
    "hpop.view.save_explorer",
    "hpop.view.save_pictures",
    "hpop.view.save_frames",
    "hpop.view.save_video",
    "hpop.view.save_ride",
    "hpop.view.widget",
    "hpop.export.save",
    "hpop.view.save_360",
    "hpop.view.render_360",
    "hpop.study.save_stimuli",
    "hpop.study.Analysis.save",
]
"""What takes long where all is right: its optional arguments are left as they are."""


class Strange:
    def __repr__(self) -> str:
        return "<strange>"


WRONG: dict[str, Callable[[], Any]] = {
    "nan": lambda: math.nan,
    "none": lambda: None,
    "text": lambda: "wrong",
    "dict": lambda: {1: 2},
    "negative": lambda: -1,
    "huge": lambda: 10**400,
    "many": lambda: 10**9,
    "object": Strange,
    "empty": list,
}


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Right]:
    """Return a room that is planned in once, and the values made of it."""
    before = Path.cwd()
    os.chdir(tmp_path_factory.mktemp("arguments"))
    yield right_values()
    os.chdir(before)


@dataclass(frozen=True)
class Door:
    """A public function, class or method; ``owner`` is the class whose instance it is called on."""

    name: str
    call: Callable[..., Any]
    owner: str | None = None
    cls: type | None = None

    @property
    def parameters(self) -> list[inspect.Parameter]:
        return [each for each in inspect.signature(self.call).parameters.values() if each.name != "self"]


def doors() -> list[Door]:
    """All of them, each once."""
    found, seen = [], set()
    for package in PACKAGES:
        module = importlib.import_module(package)
        for name in module.__all__:
            thing = getattr(module, name)
            if id(thing) in seen or not (inspect.isclass(thing) or inspect.isfunction(thing)):
                continue
            seen.add(id(thing))
            full = f"{package}.{name}"
            if not inspect.isclass(thing):
                found.append(Door(full, thing))
            elif not getattr(thing, "_is_protocol", False) and not issubclass(thing, BaseException | str):
                if full not in RESULTS and not issubclass(thing, tuple) and not hasattr(thing, "model_fields"):
                    found.append(Door(full, thing))
                found += methods(full, thing, seen)
    return [door for door in found if door.parameters]


def methods(full: str, cls: type, seen: set[int]) -> list[Door]:
    found = []
    for name in dir(cls):
        static = inspect.getattr_static(cls, name)
        function = inspect.unwrap(getattr(static, "__func__", static)) if callable(getattr(cls, name)) else None
        if name.startswith("_") or not inspect.isfunction(function) or id(function) in seen:
            continue
        if function.__module__.partition(".")[0] == "hpop":
            seen.add(id(function))
            bound = isinstance(static, staticmethod | classmethod)
            found.append(Door(f"{full}.{name}", getattr(cls, name), None if bound else full, cls))
    return found


def made(value: Any) -> Any:
    """Call a factory or a class; return every other value as it is."""
    return value() if inspect.isfunction(value) or isinstance(value, type) else value


def arguments(door: Door, right: Right) -> dict[str, Any] | None:
    """Right values for what has no default; None where nothing is known to be right."""
    found = {}
    for each in door.parameters:
        if each.kind is each.VAR_POSITIONAL:
            continue
        if each.default is not each.empty and f"{door.name}.{each.name}" not in right.names:
            continue
        kind = getattr(each.annotation, "__forward_arg__", each.annotation)
        where = [(right.names, f"{door.name}.{each.name}"), (right.types, f"{door.owner}: {kind}")]
        for known, key in (*where, (right.names, each.name), (right.types, kind)):
            if key in known:
                found[each.name] = made(known[key])
                break
        else:
            return None
    return found


def called(door: Door, right: Right, given: Mapping[str, Any]) -> Any:
    positional: list[Any] = []
    if door.owner is not None:
        positional.append(made(right.owners.get(door.name, right.owners.get(door.owner, door.cls))))
    named: dict[str, Any] = {}
    for each in door.parameters:
        if each.name not in given:
            continue
        value = given[each.name]
        if each.kind in (each.POSITIONAL_ONLY, each.VAR_POSITIONAL):
            positional.append(value)
        elif each.kind is each.VAR_KEYWORD:
            is_whole = isinstance(value, dict) and all(isinstance(key, str) for key in value)
            named |= value if is_whole else {each.name: value}
        else:
            named[each.name] = value
    answer = door.call(*positional, **named)
    return list(answer) if inspect.isgenerator(answer) else answer


def fault(door: Door, right: Right, given: Mapping[str, Any], name: str, value: Any) -> str:
    """Return the fault in the error of a call: "" where it names the argument, or where there is none."""
    try:
        called(door, right, {**given, name: value})
    except (HpopError, FrontError, FileNotFoundError):
        return ""
    except (TypeError, ValueError) as error:
        is_named = re.search(rf"\b({name}|expected|must|is no)\b", str(error)) or repr(value) in str(error)
        return "" if is_named else f"{type(error).__name__}: {error}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return ""


def is_long(door: Door) -> bool:
    return door.name in LONG or door.name.endswith((".solve", ".stages", ".bag", ".mcap")) or ".view." in door.name


def usable(right: Right) -> Iterator[tuple[Door, dict[str, Any]]]:
    """Doors whose call with right values succeeds, of those that are not long, and these."""
    for door in doors():
        given = arguments(door, right)
        if given is not None and is_long(door):
            yield door, given
        elif given is not None:
            try:
                called(door, right, given)
            except Exception:
                continue
            yield door, given


def tried(right: Right, most: int, every: int = 1) -> tuple[int, list[str]]:
    """Return the number of functions, and the faults of their errors on some wrong values of every so many arguments.

    most   wrong values for each argument
    every  1 tries all arguments, 3 each third one: another one first from function to function
    """
    faults, count = [], 0
    for door, given in usable(right):
        count += 1
        if door.name == "hpop.motions.States.take":  # takes what NumPy takes, whose error says what
            continue
        for place, each in enumerate(door.parameters):
            if (place + count) % every:
                continue
            if is_long(door) and each.default is not each.empty:
                continue
            for kind in (list(WRONG) * 2)[place % len(WRONG) :][:most]:
                if kind == "many" and not re.search(r"\b(int|float)\b", str(each.annotation)):
                    continue  # it is no number of anything
                if is_long(door) and kind == "text" and "str" in str(each.annotation):
                    continue  # it may be right
                wrong = fault(door, right, arguments(door, right) or given, each.name, WRONG[kind]())
                if wrong:
                    faults.append(f"{door.name}({each.name}={kind}): {wrong[:200]}")
    return count, faults


def test_some_wrong_values_in_the_place_of_arguments_are_answered_by_their_names(right: Right) -> None:
    count, faults = tried(right, 1, every=16)
    assert faults == []
    assert count > 480


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: hpop.DifferentialDrive(raduis=0.3), r"^DifferentialDrive: .* 'raduis'\. Did you mean 'radius'\?"),  # type: ignore[call-arg]
        (lambda: hpop.World.from_image("a.png", 0.1, treshold=1), r"from_image: .* Did you mean 'threshold'\?"),  # type: ignore[call-arg]
        (lambda: Box(0.2, 0.2, 0.5), r"^Box: expected at most 1 argument .*put them in brackets: \(0\.2, 0\.2, 0\.5\)"),  # type: ignore[call-arg]
        (lambda: pose_at(0.45, 0.3, 0.25), r"^pose_at: .*put them in brackets: \(0\.45, 0\.3, 0\.25\)"),  # type: ignore[call-arg]
        (lambda: hpop.search.pareto_paths(1, 0, 1, ["a"]), r"\(graph, source, target\), got 4; give others by name"),  # type: ignore[arg-type,call-arg]
        (lambda: hpop.search.pareto_paths(1), "missing 2 required positional"),  # type: ignore[arg-type,call-arg]
    ],
)  # fmt: skip
def test_a_call_with_an_unknown_or_a_surplus_argument_is_answered_with_those_there_are(
    call: Callable[[], Any], said: str
) -> None:
    with pytest.raises(TypeError, match=said):
        call()


@contextmanager
def little_memory(more: int) -> Iterator[None]:
    """Let this process take so many bytes of addresses more: what takes them ends in a MemoryError."""
    before, most = resource.getrlimit(resource.RLIMIT_AS)
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + more, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (before, most))


@pytest.mark.proof
def test_all_wrong_values_in_the_place_of_each_argument_are_answered_by_its_name(right: Right) -> None:
    with little_memory(2 * 1024**3):
        assert tried(right, len(WRONG))[1] == []


SILLY: dict[str, Callable[[Right], Any]] = {
    "n": lambda right: hpop.search.Graph.from_arcs(10**9, [0], [1], [[1]]),
    "nodes": lambda right: right.types["Graph"].extended(10**9, [0], [1], [[1, 1]]),
    "stimuli": lambda right: bradley_terry([0, 1], [1, 0], [0, 0], stimuli=10**6),
    "f": lambda right: hpop.preference.Prior().draw(10**9, 10, np.random.default_rng(0)),
    "count": lambda right: hpop.preference.Prior().draw(3, 10**9, np.random.default_rng(0)),
    "size": lambda right: random_motions(0, right.types["World"], right.types["Model"], "move", 10**9),
    "dpi": lambda right: save_pictures(right.types["Problem"], right.types["Front"], "pictures", dpi=3e5),
    "count of states": lambda right: right.owners["hpop.goals.AnyOf"].states(right.types["Problem"], 0, 10**9),
    "n of states": lambda right: right.types["Model"].space.sample(0, 10**9),
}


@pytest.mark.parametrize("name", SILLY)
def test_a_size_that_nothing_needs_is_refused_by_name_before_memory_is_taken(right: Right, name: str) -> None:
    with little_memory(500 * 1024**2), pytest.raises(HpopError, match=rf"^{name.split()[0]} must be .* to "):
        SILLY[name](right)


def test_candidates_spread_over_more_than_there_are_are_all_of_them(right: Right) -> None:
    candidates = right.types["Candidates"]()
    assert len(candidates.spread(10**9).trajectories) == len(candidates.trajectories)


def test_an_error_in_the_users_own_function_blames_no_argument():
    """Its division by zero was said to come from an empty list or a huge number among the arguments."""

    @checked_arguments
    def applied(function: Callable[[float], float], values: list[float], most: float = 1.0) -> list[float]:
        return [function(value) for value in values or [1 // int(most < 1.0)]]

    own: dict[str, Any] = {}
    exec(compile("def inverse(value): return 1.0 / value", "/home/user/own.py", "exec"), own)
    with pytest.raises(ZeroDivisionError):
        applied(own["inverse"], [0.0], math.inf)
    with pytest.raises(ValueError, match="applied: values must be not empty"):
        applied(own["inverse"], [])
