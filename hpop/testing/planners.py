"""Conformance checks of a planner, in small worlds with the models that it accepts."""

from __future__ import annotations

import json
import pickle
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Never, cast

import numpy as np
import shapely

from hpop.base.arguments import checked_arguments
from hpop.base.randomness import RNG, seed_of
from hpop.base.registry import make_model, models
from hpop.base.text import shown
from hpop.criteria.base import make_criterion
from hpop.criteria.costs import trajectory_costs
from hpop.errors import CriterionError, HpopError, ModelError, OptionError, UnsupportedCriterion, UnsupportedModel
from hpop.motions import Model, States, lacking
from hpop.planners.base import UNDECLARED, Candidates, Planner, make_planner, sweeps
from hpop.planners.objectives import integral_of
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.problems.verify import collision_free, verify
from hpop.runtime.limits import Progress, Status
from hpop.testing.contracts import Check, fault_of, raise_faults
from hpop.testing.worlds import drawn_states
from hpop.world import Person, Solid, Sphere, World, pose_at

ROOM = (5.0, 4.0)  # m
LEFT, RIGHT = 1.2, 3.8  # m: largest x of a start, least x of a goal
ASIDE = 0.6  # m: largest distance of start and goal from the middle line, where the box is
WALL = shapely.box(2.45, 0.0, 2.55, ROOM[1])  # between start and goal
WALKER = Person(2.4, 3.7, velocity=(0.0, -0.1), until=8.0, name="Ada")  # walks towards the box, and then leaves
TRIES = 1000  # states drawn to find a free start and goal
POSTURES = 50  # states drawn for a robot that is not in the plane
BALL = 0.2  # radius, as a share of the distance from start to goal, for a robot that is not in the plane
REPORTS = (1, 4)  # numbers of the progress reports at which the planner is interrupted
SOON = 1e-3  # s: a time limit that is exceeded before the first result, or soon after
ASKED = (
    ("length", "exposure"),
    ("length", "proximity"),
    ("duration", "rotation"),
    ("length",),
)  # criteria, of which the first that the planner accepts are used
IN_SPACE = ASKED[2:]  # criteria for a robot that is not in the plane; its exposure would need ray casting
DEMANDING = (
    "obstruction",
    "clearance",
    "smoothness",
    "rotation_time",
)  # a mean, a worst moment, a criterion with memory, and one without gradient
WORDS = frozenset({"base", "camera", "tool", "heading", "wheels", "joints", "plane", "turn-move", "rigid", "spline"})


@checked_arguments
def check_planner(planner: Planner, *, models: Sequence[Model] = (), rng: RNG = 0) -> None:
    """Raise OptionError with a list of all failed checks of a planner.

    models  to plan for; by default all registered ones, with their defaults, that the planner accepts
    rng     draws the worlds
    """
    if isinstance(planner, type) or not callable(getattr(planner, "solve", None)):
        made = f"{planner.__name__}()" if isinstance(planner, type) else "Lattice(step=0.5)"
        raise OptionError(f"expected an instance of a planner, such as {made}, got {shown(planner)}")
    checks = planner_checks(planner, models=models, rng=rng)
    raise_faults(f"planner {getattr(planner, 'name', type(planner).__name__)!r}", checks, OptionError)


def planner_checks(planner: Planner, *, models: Sequence[Model] = (), rng: RNG = 0) -> Iterator[Check]:
    """Yield the checks of a planner, one after the other; if it finds no trajectory for a model, only the first ones.

    models  to plan for; by default all registered ones, with their defaults, that the planner accepts
    """
    seed, planner = seed_of(rng), make_planner(planner)
    yield Check("declares what it needs of a model", fault_of(lambda: _needs_fault(planner)))
    accepted = [model for model in models or registered_models() if planner.needs <= model.provides]
    if not accepted:
        yield Check("accepts a registered model", f"none of them provides {', '.join(sorted(planner.needs))}")
        return
    if planner.needs:
        yield Check(
            "gives its name when it refuses a model that lacks what it needs",
            fault_of(lambda: _refusal_fault(planner, accepted[0])),
        )
    for model in accepted:
        of = f" for {model.name}" * (len(accepted) > 1)
        found: list[tuple[Problem, Candidates]] = []
        plans = Check(f"finds trajectories{of}", fault_of(lambda: _planning_fault(planner, model, seed, found)))  # noqa: B023
        yield plans
        if plans.fault:
            continue
        ((problem, first),) = found
        yield Check(f"returns a complete result{of}", fault_of(lambda: _result_fault(problem, first)))  # noqa: B023
        yield Check(f"reports costs that a re-evaluation confirms{of}", fault_of(lambda: _costs_fault(problem, first)))  # noqa: B023
        yield Check(
            f"leads from start to goal without collisions{of}",
            fault_of(lambda: _collision_fault(problem, first)),  # noqa: B023
        )
        yield Check(
            f"returns a result that can be saved and loaded{of}",
            fault_of(lambda: _saving_fault(problem, first)),  # noqa: B023
        )
        yield Check(f"finds the same result again{of}", fault_of(lambda: _repeat_fault(planner, problem, first)))  # noqa: B023
        if "plane" in model.provides:  # no wall separates the postures of an arm
            yield Check(f"reports that there is no path{of}", fault_of(lambda: _wall_fault(planner, problem)))  # noqa: B023
            yield Check(
                f"plans among people who move, or refuses them by name{of}",
                fault_of(lambda: _people_fault(planner, problem)),  # noqa: B023
            )
        yield Check(
            f"accepts criteria, or refuses them by name{of}",
            fault_of(lambda: _criteria_fault(planner, problem)),  # noqa: B023
        )
        yield Check(f"ends when it is interrupted{of}", fault_of(lambda: _interrupt_fault(planner, problem)))  # noqa: B023
        if "time_limit" in {option.name for option in fields(cast(Any, planner))}:
            yield Check(f"ends at its time limit{of}", fault_of(lambda: _time_limit_fault(planner, problem)))  # noqa: B023


def registered_models() -> list[Model]:
    """Return registered models with their defaults, except models without defaults."""
    made = []
    for name in models:
        try:
            made.append(cast(Model, make_model(name)))
        except HpopError:
            continue
    return made


def small_problem(model: Model, criteria: Sequence[str], seed: int = 0) -> Problem:
    """Return a problem with a small obstacle between two free states; the goal leaves angles free."""
    rng = np.random.default_rng(seed)
    world, start, goal = (_in_a_room if "plane" in model.provides else _in_space)(model, rng)
    space = model.space
    turning = tuple(None if n in space.turning else v for n, v in zip(space.names, space.values(goal), strict=True))
    return Problem(world, model, cast(Any, space.values(start)), turning, list(criteria))


def _in_a_room(model: Model, rng: np.random.Generator) -> tuple[World, States, States]:
    """Return a room with a box, and free states to the left and right of the box."""
    corner, size = rng.uniform((1.8, 1.2), (2.1, 1.5)), rng.uniform((0.6, 0.9), (0.9, 1.2))
    world = World.from_polygons([shapely.box(*corner, *(corner + size))], extent=shapely.box(0, 0, *ROOM))
    states = _free_states(model, world, drawn_states(model, world, rng, TRIES))
    pose = model.pose("base" if "base" in model.provides else "camera", states)
    middle = np.abs(pose.y - 0.5 * ROOM[1]) < ASIDE
    start, goal = (states.take(np.flatnonzero(middle & at)[:1]) for at in (pose.x < LEFT, pose.x > RIGHT))
    return world, start, goal


def _in_space(model: Model, rng: np.random.Generator) -> tuple[World, States, States]:
    """Return a world with a ball, and two free states; the ball lies between their camera positions."""
    extent = shapely.box(0, 0, *ROOM)  # its border is no wall for robots in space
    nowhere = World.from_solids([], extent=extent)
    states = _free_states(model, nowhere, drawn_states(model, nowhere, rng, POSTURES))
    if "time" in model.provides:  # the first state is the start, the others are goals
        time, (low, high) = model.space.names[-1], (model.space.low[-1], model.space.high[-1])
        states = States(**states.__dict__ | {time: np.where(np.arange(states.size) > 0, high, low)})
    pose = model.pose("camera", states)
    places = np.stack([pose.x, pose.y, pose.z], axis=1)
    start = states.take(slice(1))
    for other in range(1, states.size):
        apart = float(np.linalg.norm(places[other] - places[0]))
        ball = Solid(Sphere(BALL * apart), pose_at(tuple(0.5 * (places[0] + places[other]))), "ball")
        world, goal = World.from_solids([ball], extent=extent), states.take(slice(other, other + 1))
        if all(_free_states(model, world, end).size for end in (start, goal)):
            return world, start, goal
    raise ModelError(
        f"expected two states of {model.name} that are free with a ball between their camera positions, found none "
        f"among {POSTURES} random states; check the limits of its joints and its collision test"
    )


def _free_states(model: Model, world: World, states: States) -> States:
    return states.take(
        np.flatnonzero(model.collision(world).states_free(states) & model.judge(world).states_free(states))
    )


# Needs and results


def _needs_fault(planner: Planner) -> str:
    if planner.needs is UNDECLARED:
        return "it declares no needs; set needs = frozenset() if it can plan for any model"
    strange = planner.needs - WORDS
    return f"needs must be among {', '.join(sorted(WORDS))}, got {', '.join(sorted(strange))}" if strange else ""


class _Bare:
    """Model that provides only the bodies of another model."""

    def __init__(self, model: Model) -> None:
        self.model = model

    def __getattr__(self, name: str) -> Any:
        return getattr(self.__dict__["model"], name)

    def with_scene(self, world: World) -> _Bare:
        return _Bare(self.model.with_scene(world))

    @property
    def provides(self) -> frozenset[str]:
        return self.model.provides & {"base", "camera"}


def _refusal_fault(planner: Planner, model: Model) -> str:
    problem = small_problem(model, ["duration"])
    bare = Problem(problem.world, cast(Model, _Bare(model)), problem.start, problem.goal, ["duration"])
    try:
        bare.solve(planner)
    except UnsupportedModel as error:
        return "" if planner.name in str(error) else f"its error does not name the planner: {error}"
    return "it planned for such a model; raise UnsupportedModel"


def _planning_fault(planner: Planner, model: Model, seed: int, found: list[tuple[Problem, Candidates]]) -> str:
    """Plan with the first criteria that the planner accepts; add problem and result to ``found``.

    Returns a fault if the planner accepts no criteria, or finds no trajectory; "" otherwise.
    """
    asked = ASKED if "plane" in model.provides else IN_SPACE
    for criteria in asked:
        try:
            problem = small_problem(model, criteria, seed)
            candidates = planner.solve(problem)
        except CriterionError:  # the planner or the model does not support these criteria
            continue
        if not len(candidates.trajectories):  # it may find no path around a box
            problem = replace(problem, world=World.from_polygons([], extent=problem.world.extent))
            candidates = planner.solve(problem)
        if not len(candidates.trajectories):
            return f"it finds no path in an empty room: {candidates.status}, {'; '.join(candidates.notes)}"
        found.append((problem, candidates))
        return ""
    return f"it accepts none of these criteria: {', '.join(' and '.join(criteria) for criteria in asked)}"


def _result_fault(problem: Problem, found: Candidates) -> str:
    shape = (len(found.trajectories), len(found.objectives))
    for what, array in (("planned", found.planned), ("tolerance", found.tolerance)):
        if np.shape(array) != shape:
            return f"{what} must have the shape {shape} (trajectories, objectives), got {np.shape(array)}"
    if not isinstance(found.status, Status):
        return f"status must be a hpop.Status, got {shown(found.status)}"
    if not found.certificate.strip():
        return "certificate must say what is claimed of the front, but it is empty"
    if len(found.provenance) != shape[0] or any("planner" not in origin for origin in found.provenance):
        return f"provenance must have an entry with the key 'planner' for each of {shape[0]} trajectories"
    json.dumps([list(found.provenance), dict(found.stats)], allow_nan=False)
    strange = {trajectory.model for trajectory in found.trajectories} - {problem.model}
    return f"its trajectories must be of the problem's model, got {strange}" if strange else ""


def _costs_fault(problem: Problem, found: Candidates) -> str:
    again = trajectory_costs(found.objectives, list(found.trajectories), problem.world)
    off = np.abs(again - found.planned) > found.tolerance + 1e-9 * np.abs(again)
    for i, j in np.argwhere(off):
        name = found.objectives[j].name
        return f"{name} of trajectory {i} is reported as {found.planned[i, j]:.9g}, but it is {again[i, j]:.9g}"
    return ""


def _collision_fault(problem: Problem, found: Candidates) -> str:
    colliding = np.flatnonzero(~collision_free(problem, found.trajectories))
    if colliding.size:
        return f"trajectory {colliding[0]} collides by the model's judge()"
    return "; ".join(verify(problem, problem.front(found)))


def _saving_fault(problem: Problem, found: Candidates) -> str:
    front = problem.front(found)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "front.json"
        front.save(file)
        again = Front.load(file)
    if not np.array_equal(again.costs, front.costs) or again.certificate != front.certificate:
        return "its costs or its certificate are different after loading"
    return "; ".join(verify(Problem.from_description(again.problem or {}), again))


# Behaviour


def _difference(expected: Candidates, found: Candidates) -> str:
    if not np.array_equal(expected.planned, found.planned):
        return f"{len(expected.planned)} trajectories first, then {len(found.planned)}, or other costs"
    for i, (one, other) in enumerate(zip(expected.trajectories, found.trajectories, strict=True)):
        if one.describe() != other.describe():
            return f"trajectory {i} is different the second time"
    return ""


def _repeat_fault(planner: Planner, problem: Problem, first: Candidates) -> str:
    """Return a fault if a pickled copy has another result, else ""; planners that accept an executor run on one."""
    copy = pickle.loads(pickle.dumps(planner))
    if not sweeps(planner):
        return _difference(first, copy.solve(problem))
    with ThreadPoolExecutor(2) as threads:
        fault = _difference(first, copy.solve(problem, executor=threads))
    return f"on an executor: {fault}" if fault else ""


def _wall_fault(planner: Planner, problem: Problem) -> str:
    """Return a fault if the planner finds a path through a wall; "" otherwise.

    An empty result that is complete must have a note that no path exists.
    """
    world = World.from_polygons([WALL], extent=problem.world.extent)
    found = planner.solve(replace(problem, world=world))
    if len(found.trajectories):
        return f"it finds {len(found.trajectories)} trajectories through a wall"
    claims = found.status is Status.COMPLETE and not found.notes
    return "its empty result is complete, but no note says that there is no path; add one to notes" if claims else ""


def _people_fault(planner: Planner, problem: Problem) -> str:
    """Return a fault if a result touches a person who crosses the room, or a refusal does not say why; "" otherwise."""
    among = replace(problem, world=problem.world.with_content(people=[WALKER]))
    try:
        found = planner.solve(among)
    except HpopError as error:
        said = str(error)
        known = WALKER.name in said or any(criterion.name in said for criterion in problem.criteria)
        return "" if known else f"it refuses a moving person, but its error names neither person nor criterion: {said}"
    if fault := _result_fault(among, found) or _costs_fault(among, found) or _collision_fault(among, found):
        return fault
    return _difference(found, pickle.loads(pickle.dumps(planner)).solve(among))


class _Begun(BaseException):
    """Signal that a planner has accepted the criteria and begun."""


def _stop(progress: Progress) -> Never:
    raise _Begun


def _criteria_fault(planner: Planner, problem: Problem) -> str:
    for name in DEMANDING:
        asked = make_criterion(name)
        if lacking(asked.requires, problem.model, problem.world):
            continue
        called = {name, integral_of(asked).name if asked.aggregate == "time-mean" else name}
        for criteria in ([name], [problem.criteria[0].name, name]):
            try:
                planner.solve(replace(problem, criteria=cast(Any, criteria)), _stop)
            except _Begun:
                continue
            except UnsupportedCriterion as error:
                if not any(known in str(error) for known in called):
                    return f"it refuses {name}, but its error does not name it: {error}"
    return ""


def _interrupt_fault(planner: Planner, problem: Problem) -> str:
    """Return a fault of the results after Ctrl-C, at an early and at a later progress report; "" otherwise."""
    for number in REPORTS:
        reports = count(1)

        def interrupt(progress: Progress) -> None:
            if next(reports) == number:  # noqa: B023
                raise KeyboardInterrupt

        try:
            found = planner.solve(problem, interrupt)
        except KeyboardInterrupt:
            continue
        if fault := _early_end_fault(problem, found):
            return fault
    return ""


def _time_limit_fault(planner: Planner, problem: Problem) -> str:
    return _early_end_fault(problem, replace(cast(Any, planner), time_limit=SOON).solve(problem))


def _early_end_fault(problem: Problem, found: Candidates) -> str:
    """Return a fault of a result that ended early; "" otherwise."""
    return _result_fault(problem, found) or _costs_fault(problem, found) or _collision_fault(problem, found)
