"""Jobs of planners that solve programs, on any executor."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import pytest
import shapely

from hpop.base.math import is_symbolic
from hpop.criteria import Length
from hpop.models import DifferentialDrive
from hpop.planners import EpsilonConstraint, Smoothing
from hpop.planners.programs import ONE_PROGRAM
from hpop.planners.programs.epsilon_constraint import program as polyline
from hpop.planners.programs.smoothing import program as driven_program
from hpop.problems.problem import Problem
from hpop.world import World

BLOCK = World.from_polygons([shapely.box(2.8, 1.4, 3.4, 2.6)], extent=shapely.box(0, 0, 6, 4))
ROUND = Problem(BLOCK, DifferentialDrive(radius=0.25), (1, 2, 0), (5, 2, 0), ("turns", "length", "exposure"))


@pytest.mark.cases("planner1-hpop.planners.programs.epsilon_constraint.program")
@pytest.mark.parametrize(
    ("planner", "module"),
    [(Smoothing(step=1.0, intervals=10), driven_program), (EpsilonConstraint(step=1.0, max_points=3), polyline)],
)
def test_threads_of_a_process_solve_one_program_at_a_time(planner, module, monkeypatch):
    """Two at once end the process: a Dask worker has as many threads as cores.

    Each has the lock while it solves. The last one is alone: whose lock was another's would be found out there.
    """
    busy, together, locked = [], [], []

    @contextmanager
    def watched():
        busy.append(None)
        together.append(len(busy))
        locked.append(ONE_PROGRAM.locked())
        yield
        busy.pop()

    monkeypatch.setattr(module, "interrupts_held", watched)
    with ThreadPoolExecutor(2) as threads:
        found = planner.solve(ROUND, executor=threads)
    assert len(found.trajectories) > 1
    assert set(together) == {1}
    assert all(locked)


@dataclass(frozen=True)
class WatchedLength(Length):
    """A length that notes whether it has the lock while it builds symbols."""

    locked: list[bool] = field(default_factory=list, compare=False)

    def cost(self, m):
        if is_symbolic(m.start.x):
            self.locked.append(ONE_PROGRAM.locked())
        return super().cost(m)


@pytest.mark.cases("planner1")
@pytest.mark.parametrize("planner", [Smoothing(step=1.0), EpsilonConstraint(step=1.0)])
def test_whoever_builds_symbols_has_the_lock(planner):
    """So threads that plan build them one after the other."""
    watched = WatchedLength()
    problem = replace(ROUND, criteria=("turns", watched))
    assert len(problem.solve(planner))
    assert len(watched.locked) > 1
    assert all(watched.locked)
