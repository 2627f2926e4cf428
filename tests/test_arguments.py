"""Whatever stands in the place of an argument of a public function or method, the error names the argument."""

from __future__ import annotations

import importlib
import inspect
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop import export, motions, preference, ros, search, study
from hpop.errors import HpopError
from hpop.frontier.errors import FrontError
from hpop.history import History
from hpop.search.timed import TimedGraph, timed_paths
from hpop.study import statistics
from hpop.world import Box, Person, Raster, Solid, pose_at
from hpop.world.content import Landmark
from tests.study.sessions import answered

PACKAGES = [
    "hpop",
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
    "hpop.planners.trust",
    "hpop.preference",
    "hpop.ros",
    "hpop.search",
    "hpop.search.timed",
    "hpop.study",
    "hpop.study.statistics",
    "hpop.testing",
    "hpop.view",
    "hpop.world",
    "hpop.world.content",
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
    "hpop.frontier.Point",
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
]
"""Classes that hpop makes and nobody else: their constructors check nothing, their methods do."""
LONG = [
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
    "object": Strange,
    "empty": list,
}


@dataclass
class Right:
    """Values by the type of a parameter, by its name, and by the class whose methods are called."""

    types: dict[str, Any]
    names: dict[str, Any]
    owners: dict[str, Any]


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Right]:
    """A room that is planned in once, and what is made of it."""
    before = Path.cwd()
    os.chdir(tmp_path_factory.mktemp("arguments"))
    world = hpop.World.from_polygons([shapely.box(2, 1, 3, 3)], extent=shapely.box(0, 0, 5, 4))
    world = world.with_content(people=[Person(1, 3, 0)], landmarks=[Landmark(4, 3)])
    robot = hpop.DifferentialDrive(radius=0.2)
    problem = hpop.Problem(world, robot, (0.5, 2, 0), (4.5, 2, None), ["exposure", "turns", "length"])
    front = problem.solve(step=0.5)
    front.save("front.json")
    way = front.trajectories[0]
    _, moves = next(way.batches(world))
    states = way.states
    law = motions.laws_of(robot)[moves.law.kind]
    planner = hpop.Lattice(step=0.5)
    driven = hpop.follow(problem, front, 0)
    driven.save("drive.json")
    options = driven.options(0.0)
    graph = search.Graph.from_arcs(3, [0, 1, 0], [1, 2, 2], [[1, 2], [1, 2], [3, 1]])
    timed = TimedGraph(graph, np.ones(3, np.int32), 5)
    design = study.Design.of(front, [0, 1], participants=2, consent="You may stop.")
    Path("study").mkdir()
    design.save("study")
    answered(design, Path("study"), [person.id for person in design.enrolled])
    answers, form = study.Answers.load("study", design), design.questionnaires[0]
    person = preference.Preference.fit(front, [(0, 1)])
    person.save("person.json")
    planning = ros.Planning(problem, [planner], ros.Interface())
    solid = Solid(Box((1, 1, 1)), pose_at((0, 0, 0)))
    square, track = shapely.box(0, 0, 1, 1), hpop.Track(np.arange(3.0), np.arange(3.0), np.zeros(3))
    raster = Raster(np.zeros((5, 5), bool), 0.5)
    types: dict[str, Any] = {
        "World": world, "Model": robot, "Problem": problem, "Front": front, "Front[Any]": front, "Trajectory": way,
        "Trajectory | Front": way, "Front | Trajectory": way, "States": states, "Motions": moves, "Law": law,
        "History": lambda: History(world, way), "Column": np.array([0.1, 0.2]), "FloatArray": np.array([0.1, 0.2]),
        "FloatArray | float": 0.5, "IntArray": np.array([0]), "ArrayLike": [[1.0, 2.0], [2.0, 1.0]],
        "StateSpace": robot.space, "Pose": moves.camera.end, "Criterion": problem.criteria[0],
        "CriterionSpec": "length", "Sequence[CriterionSpec]": ["length"], "Sequence[Criterion]": problem.criteria,
        "tuple[Criterion, ...]": problem.criteria, "StateSpec": (0.5, 2, 0), "GoalSpec": (4.5, 2, None),
        "PlannerSpec": "lattice", "Iterable[PlannerSpec]": [planner], "Planner": planner,
        "Sequence[Planner]": [planner],
        "Candidates": lambda: planner.solve(problem), "Sequence[Trajectory]": front.trajectories,
        "Point | int | str | Preferring": 0, "Option | Point | int": 0, "str | os.PathLike[str]": "front.json",
        "str": "length", "float": 0.5, "int": 1, "bool": False, "Sequence[str]": ["length"],
        "Mapping[str, float]": {"length": 1.0}, "Mapping[str, Any]": {}, "Options": options, "Execution": driven,
        "Exported": export.Exported(way), "Graph": graph, "Graph | nx.Graph[Any]": graph, "Hashable": 0,
        "Hashable | Iterable[Hashable]": 2, "TimedGraph": timed, "Design": design, "Answers": answers, "Form": form,
        "Preference": person, "Sequence[Preference]": [person], "Track": track, "Person": world.content.people[0],
        "Sequence[Happening]": [], "BaseGeometry": square, "Polygon": square, "RNG": 0, "Mapping[Any, Any]": {},
        "np.random.Generator": lambda: np.random.default_rng(0), "Solid": solid, "Shape": solid.shape,
        "Heights": (0.0, 1.0), "tuple[float, float, float]": (1.0, 1.0, 1.0), "tuple[float, float]": (1.0, 2.0),
        "Iterable[Solid]": [solid], "PathServer": lambda: ros.PathServer(planning), "Planning": planning,
        "Interface": ros.Interface(), "Any": [[1, 2, 3], [2, 3, 1], [3, 1, 2]], "Sequence[float]": (0.0, 0.0, 0.0),
        "Iterable[BaseGeometry | tuple[BaseGeometry, Heights]]": [square], "Sequence[int]": [0, 1],
        "Sequence[Any]": [[1, 2, 3], [2, 3, 1]], "Iterable[Event]": [], "object": 0, "Collection[str]": ["camera"],
        "Sequence[Sequence[float]]": [(0, 0, 0), (1, 1, 0)], "Collision": robot.collision(world), "Path": Path("study"),
        "Twist": robot.twist("camera", states, states), "Iterable[Any]": [], "float | None": 0.5,
        "Ground": world.ground,
        "Sequence[tuple[float, float, float]]": [(0, 0, 0), (1, 1, 0)], "tuple[str, ...]": way.kinds,
        "Sequence[int | str | NamedRow]": [0, 1], "Sequence[int] | IntArray": [0], "CheckpointSpec": "checkpoint",
        "str | bytes": "{}", "BoolArray": np.zeros((5, 5), bool), "int | None": None, "PlanarPose | None": None,
        "Sequence[Trajectory] | Sequence[int]": [0, 1, 2], "Item": form.items[0], "Problem | None": problem,
        "Iterable[Shown]": [], "Mapping[str, Any] | None": None, "Trajectory | None": None,
        "type[W]": lambda: type(world),
        "FreeSpace": world.free_space(), "Iterable[str]": [], "Callable[[], T]": lambda: (lambda: 1),
        "tuple[Any, ...]": ("key",), "Group": "C", "Aggregate": "sum", "Rate": lambda: (lambda m: np.ones(len(moves))),
        "Mapping[int, Any]": {}, "ParetoPaths": search.pareto_paths(graph, 0, 2), "Goal": problem.goal,
    }  # fmt: skip
    names: dict[str, Any] = {
        "hpop.goals.goal.name": "mine", "hpop.model.name": "mine", "hpop.planners.planner.name": "mine",
        "hpop.criterion.name": "mine", "hpop.criterion.unit": "m", "body": "camera", "t": 0.5, "seconds": 1.0,
        "hpop.drive.load.path": "drive.json", "hpop.preference.Preference.load.path": "person.json", "folder": "study",
        "hpop.export.save.folder": "out", "hpop.study.save_stimuli.folder": "out", "hpop.export.write.path": "a.tum",
        "participant": "p01", "letter": "A", "deadline": 5.0, "form": form.id, "hpop.study.score.form": form,
        "hpop.DifferentialDrive.body.name": "camera", "hpop.PanTilt.body.name": "camera",
        "hpop.Motions.body.name": "camera", "yaw": np.array([0.1, 0.2]), "hpop.motions.StateSpace.called.name": "x",
        "hpop.motions.integrated.name": "length", "hpop.study.power.effect": 0.5, "count": 2, "stimuli": 2, "total": 3,
        "hpop.frontier.hypervolume.reference": [3.0, 3.0], "pieces": np.array([0, 1]), "hpop.Motions.moments.pieces": 2,
        "hpop.Front.of.items": list(front.trajectories), "hpop.Front.of.costs": front.costs, "quanta": [1.0, 1.0],
        "hpop.Front.where.named": {"length": "<=100"}, "hpop.Front.where.conditions_by_name": {"length": "<=100"},
        "hpop.Front.select.weights": {"length": 1.0}, "shares": {"length": 1.0}, "also": [], "metres_a_radian": 0.5,
        "hpop.Problem.from_description.description": problem.describe(), "hpop.Problem.at.state": (0.5, 2, 0),
        "hpop.World.from_description.description": world.describe(), "hpop.World.from_cells.resolution": 0.1,
        "hpop.Trajectory.from_description.description": way.describe(), "hpop.models.driven.driven.pose": (0, 0, 0),
        "hpop.models.driven.driven.controls": [(1.0, 1.0, 0.0)], "corners": ((0, 0), (1, 0), (1, 1)), "z_min": 0.0,
        "z_max": 1.0, "hpop.motions.StateSpace.bounded.bounds": (0.0, 1.0), "hpop.world.Solid.pose": np.eye(4),
        "hpop.world.Hull.points": np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        "hpop.search.timed.timed_paths.source": 0, "hpop.search.pareto_paths.source": 0,
        "hpop.search.supported_paths.source": 0,
        "hpop.search.Prepared.least_ways.source": 0, "hpop.search.Prepared.paths.source": 0,
        "hpop.world.Field.values": np.zeros((3, 3)), "directions": np.array([[1.0, 0, 0]]), "times": np.array([0.0, 1]),
        "hpop.Track.x": np.array([0.0, 1]), "hpop.Track.y": np.array([0.0, 1]), "given": (1, 1, 0), "level": 0.9,
        "hpop.testing.random_motions.kind": "straight", "position": (4.0, 3.0, 1.0), "distance": (1.0, 2.0),
        "hpop.Trajectory.kinds": way.kinds, "tails": [0], "heads": [1],
        "hpop.search.Graph.from_arcs.costs": [[1]], "share": np.array([0.5]), "hpop.search.Prepared.close.arcs": [0],
        "hpop.search.Prepared.open.arcs": [0], "wish": "length", "hpop.drive.Execution.wish.wish": "length",
        "hpop.study.Design.of.participants": 2, "chosen_row": 0, "hpop.study.Answers.matrix.score": "total",
        "score": "total",
        "hpop.study.analyse.score": (form.id, form.scores[0].name), "chosen": [0, 1], "first": [0, 1], "second": [1, 0],
        "hpop.preference.Preference.told.first": 0, "hpop.preference.Preference.told.second": 1,
        "hpop.preference.Preference.told.chosen": 0, "hpop.export.tum.given": export.Exported(way),
    }  # fmt: skip
    names |= {f"hpop.export.{one}.given": export.Exported(way) for one in export.__all__}
    owners: dict[str, Any] = {
        "hpop.Front": front, "hpop.Trajectory": way, "hpop.Problem": problem, "hpop.World": world,
        "hpop.Motions": moves,
        "hpop.DifferentialDrive": robot, "hpop.Lattice": planner, "hpop.Person": Person(1, 1, 0, velocity=(1, 0)),
        "hpop.Planning": hpop.Planning(world, robot, ["turns", "length"]),
        "hpop.Track": track, "hpop.drive.Execution": driven,
        "hpop.drive.Options": options, "hpop.search.Graph": graph, "hpop.search.ParetoPaths": types["ParetoPaths"],
        "hpop.preference.Preference": person, "hpop.preference.Prior": preference.Prior(),
        "hpop.preference.People": preference.People([person]), "hpop.study.Design": design, "hpop.study.Form": form,
        "hpop.study.Answers": answers, "hpop.planners.Candidates": types["Candidates"], "hpop.ros.Planning": planning,
        "hpop.search.Prepared": lambda: search.Prepared(graph, 2), "hpop.ros.PathServer": types["PathServer"],
        "hpop.world.Ground": world.ground, "hpop.world.Raster": raster, "hpop.motions.StateSpace": robot.space,
        "hpop.motions.States": states, "hpop.frontier.Front": hpop.frontier.Front.of([[1.0, 2], [2, 1]]),
        "hpop.search.timed.TimedPaths": timed_paths(timed, 0, 2), "hpop.models.base.PlanarModel": robot,
        "hpop.study.Analysis": lambda: study.analyse(design, answers), "hpop.world.Field": world.clearance_field(),
        "hpop.study.statistics.Strengths": statistics.bradley_terry([0, 1] * 2, [1, 0] * 2, [0, 0, 1, 1], stimuli=2),
        "hpop.export.Exported": export.Exported(way), "hpop.export.Frames": export.Frames(),
        "hpop.world.Box": Box((1, 1, 1)),
        "hpop.world.Cylinder": hpop.world.Cylinder(1, 1), "hpop.world.Sphere": hpop.world.Sphere(1),
        "hpop.goals.GoalSet": lambda: hpop.Problem(world, robot, (0.5, 2, 0), [(4, 2, 0), (4, 3, 0)], ["length"]).goal,
    }  # fmt: skip
    yield Right(types, names, owners)
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
    """What a factory or a class makes: every other value is itself."""
    return value() if inspect.isfunction(value) or isinstance(value, type) else value


def arguments(door: Door, right: Right) -> dict[str, Any] | None:
    """Right values for what has no default; None where nothing is known to be right."""
    found = {}
    for each in door.parameters:
        if each.default is not each.empty or each.kind is each.VAR_POSITIONAL:
            continue
        kind = getattr(each.annotation, "__forward_arg__", each.annotation)
        for known, key in ((right.names, f"{door.name}.{each.name}"), (right.names, each.name), (right.types, kind)):
            if key in known:
                found[each.name] = made(known[key])
                break
        else:
            return None
    return found


def called(door: Door, right: Right, given: Mapping[str, Any]) -> Any:
    positional: list[Any] = []
    if door.owner is not None:
        positional.append(made(right.owners.get(door.owner, door.cls)))
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
    """What is wrong with the error of a call, "" where it names the argument or where there is none."""
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


def tried(right: Right, most: int) -> tuple[int, list[str]]:
    """Try each argument with some of the wrong values; the number of doors, and what is wrong with their errors."""
    faults, count = [], 0
    for door, given in usable(right):
        count += 1
        if door.name == "hpop.motions.States.take":  # takes what NumPy takes, whose error says what
            continue
        for place, each in enumerate(door.parameters):
            if is_long(door) and each.default is not each.empty:
                continue
            for kind in (list(WRONG) * 2)[place % len(WRONG) :][:most]:
                if is_long(door) and kind == "text" and "str" in str(each.annotation):
                    continue  # it may be right
                wrong = fault(door, right, arguments(door, right) or given, each.name, WRONG[kind]())
                if wrong:
                    faults.append(f"{door.name}({each.name}={kind}): {wrong[:200]}")
    return count, faults


def test_some_wrong_values_in_the_place_of_each_argument_are_answered_by_its_name(right: Right) -> None:
    count, faults = tried(right, 1)
    assert faults == []
    assert count > 350


@pytest.mark.proof
def test_all_wrong_values_in_the_place_of_each_argument_are_answered_by_its_name(right: Right) -> None:
    assert tried(right, len(WRONG))[1] == []
