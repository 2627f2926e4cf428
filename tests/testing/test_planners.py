"""Conformance checks of planners: a good one passes them all, and each kind of mistake fails the right one."""

from __future__ import annotations

import re
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np
import pytest

import hpop
from hpop.errors import OptionError, QueryError, UnsupportedCriterion
from hpop.planners import Candidates, Lattice
from hpop.problems.problem import Problem
from hpop.runtime.limits import ProgressCallback, Status
from hpop.testing import check_planner
from hpop.testing.planners import planner_checks
from hpop.trajectories.trajectory import Trajectory

ROBOT = hpop.DifferentialDrive(radius=0.2)
NEEDS = "declares what it needs of a model"
REFUSES = "gives its name when it refuses a model that lacks what it needs"
FINDS = "finds trajectories"
SAYS = "returns a complete result"
COSTS = "reports costs that a re-evaluation confirms"
KEEPS = "leads from start to goal without collisions"
SAVED = "returns a result that can be saved and loaded"
AGAIN = "finds the same result again"
PEOPLE = "plans among people who move, or refuses them by name"
NO_PATH = "reports that there is no path"
CRITERIA = "accepts criteria, or refuses them by name"
INTERRUPTED = "ends when it is interrupted"
LATE = "ends at its time limit"
CLAIMS = [NEEDS, REFUSES, FINDS, SAYS, COSTS, KEEPS, SAVED, AGAIN, NO_PATH, PEOPLE, CRITERIA, INTERRUPTED, LATE]

Change = Callable[[Candidates, Problem], Candidates]


def unchanged(found: Candidates, problem: Problem) -> Candidates:
    return found


@dataclass(frozen=True)
class Changed:
    """Planner that returns the lattice's result with one thing changed."""

    change: Change = unchanged

    name = "changed"
    needs = Lattice.needs

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        return self.change(Lattice(step=1.0).solve(problem, progress), problem)


def short(found: Candidates, problem: Problem) -> Candidates:
    """Costs that are too small."""
    return replace(found, planned=0.9 * found.planned)


def silent(found: Candidates, problem: Problem) -> Candidates:
    return replace(found, certificate=" ")


def nameless(found: Candidates, problem: Problem) -> Candidates:
    return replace(found, provenance=({},) * len(found.trajectories))


def lost(found: Candidates, problem: Problem) -> Candidates:
    return replace(found, planned=found.planned[:, :1])


def made(found: Candidates, problem: Problem, rows: list[tuple[float, ...]]) -> Candidates:
    """One trajectory through poses in the place of all, its costs as they are."""
    trajectory = Trajectory.from_poses(problem.model, rows)
    planned = np.array([list(problem.evaluate(trajectory).values())])
    one = found.subset([0])
    return replace(one, trajectories=(trajectory,), planned=planned, tolerance=0.0 * planned)


def through(found: Candidates, problem: Problem) -> Candidates:
    """Straight on, through whatever is there."""
    x, y, _ = problem.goals[0]
    return made(found, problem, [problem.start, (2.3, 1.5, 0.0), (x, y, 0.0)])


def elsewhere(found: Candidates, problem: Problem) -> Candidates:
    """To a place beside the goal."""
    states = found.trajectories[0].states
    rows = [(float(states.x[i]), float(states.y[i]), 0.0) for i in range(states.size - 1)]
    return made(found, problem, [problem.start, *rows])


def into_people(found: Candidates, problem: Problem) -> Candidates:
    """Redirect a path to where a person walks, by way of the upper wall."""
    x, (to_x, to_y, _) = problem.start[0], problem.goals[0]
    if not problem.world.content.people:
        return found
    return made(found, problem, [problem.start, (x, 3.2, 0.0), (to_x, 3.2, 0.0), (to_x, to_y, 0.0)])


class Curt(Changed):
    """Refuses people without a name."""

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        if problem.world.content.people:
            raise QueryError("not here")
        return super().solve(problem, progress)


CALLS = count()


def moody(found: Candidates, problem: Problem) -> Candidates:
    return found.subset(range(1 + next(CALLS) % len(found.trajectories))) if len(found.trajectories) else found


def dumb(found: Candidates, problem: Problem) -> Candidates:
    """Nothing, and that is called complete."""
    nothing = found.subset([])
    return replace(nothing, status=Status.COMPLETE, notes=()) if not len(found.trajectories) else found


@dataclass(frozen=True)
class Undeclared:
    """Says nothing of its needs."""

    name = "undeclared"

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        return Lattice(step=1.0).solve(problem, progress)


class Strange(Changed):
    needs = Lattice.needs | {"wings"}


class Needless(Changed):
    """Needs of which another planner knows nothing."""

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        raise UnsupportedCriterion("no")


class Mumbling(Changed):
    """Refuses criteria without a name."""

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        if any(not criterion.smooth for criterion in problem.criteria):
            raise UnsupportedCriterion("not this one")
        return super().solve(problem, progress)


class Crashing(Changed):
    """Cannot stop."""

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        try:
            return super().solve(problem, progress)
        except KeyboardInterrupt:
            raise ValueError("half a front") from None


class Sweeping(Changed):
    """Finds less on an executor."""

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates:
        found = super().solve(problem, progress)
        return found if executor is None else found.subset([0])


@dataclass(frozen=True)
class Hurried(Changed):
    """Planner whose costs differ once its time is over."""

    time_limit: float | None = None

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        found = super().solve(problem, progress)
        return found if self.time_limit is None else short(found, problem)


class Copied(Changed):
    def __reduce__(self) -> tuple[Any, ...]:
        raise TypeError("cannot be pickled")


MISTAKES = [
    (NEEDS, "it declares no needs; set", Undeclared()),
    (NEEDS, "needs must be among base, .*, got wings", Strange()),
    (FINDS, "it accepts none of these criteria: length and exposure", Needless()),
    (COSTS, "length of trajectory 0 is reported as", Changed(short)),
    (SAYS, "certificate must say what is claimed of the front, but it is empty", Changed(silent)),
    (SAYS, "provenance must have an entry with the key 'planner'", Changed(nameless)),
    (SAYS, "planned must have the shape", Changed(lost)),
    (KEEPS, "trajectory 0 collides", Changed(through)),
    (KEEPS, "m from the goal", Changed(elsewhere)),
    (AGAIN, "trajectories first, then", Changed(moody)),
    (AGAIN, "on an executor: ", Sweeping()),
    (AGAIN, "cannot be pickled", Copied()),
    (NO_PATH, "its empty result is complete, but no note", Changed(dumb)),
    (PEOPLE, "touches Ada at", Changed(into_people)),
    (PEOPLE, "it refuses a moving person, but its error names neither", Curt()),
    (CRITERIA, "it refuses .*, but its error does not name it", Mumbling()),
    (INTERRUPTED, "ValueError: half a front", Crashing()),
    (LATE, "length of trajectory 0 is reported as", Hurried()),
]


@pytest.mark.parametrize(("claim", "text", "planner"), MISTAKES, ids=[text for _, text, _ in MISTAKES])
def test_a_mistake_fails_the_check_that_names_it(claim: str, text: str, planner: Any) -> None:
    for check in planner_checks(planner, models=[ROBOT]):
        if check.claim == claim:
            assert re.search(text, check.fault)
            return
    pytest.fail(f"not looked at: {claim}")


def test_all_faults_are_raised_together() -> None:
    with pytest.raises(OptionError) as raised:
        check_planner(Changed(silent), models=[ROBOT])
    first, *faults = str(raised.value).split("\n  ")
    assert first == f"planner 'changed' fails {len(faults)} check{'s' * (len(faults) > 1)}:"
    assert f"{SAYS}: certificate must say what is claimed of the front, but it is empty" in faults[0]


def test_a_good_planner_passes_every_check_in_this_order() -> None:
    checks = list(planner_checks(Lattice(step=0.5), models=[ROBOT]))
    assert [check.claim for check in checks] == CLAIMS
    assert not [check for check in checks if check.fault]


def test_a_planner_that_no_model_serves_is_told_so() -> None:
    with pytest.raises(OptionError, match=r"accepts a registered model: none of them provides .*wings"):
        check_planner(Strange())


@pytest.mark.parametrize(("given", "said"), [(Lattice, r"Lattice\(\)"), ("lattice", r"Lattice\(step=0.5\)")])
def test_what_is_no_planner_is_said(given: Any, said: str) -> None:
    with pytest.raises(OptionError, match=f"expected an instance of a planner, such as {said}"):
        check_planner(given)
