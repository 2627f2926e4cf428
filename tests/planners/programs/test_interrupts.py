"""Ctrl-C while CasADi calls Python: CasADi by itself makes an evaluation that failed of it, or an error of its own."""

import signal
from contextlib import suppress

import pytest
import shapely

from hpop.models import DifferentialDrive
from hpop.planners import EpsilonConstraint, Smoothing
from hpop.planners.programs._stop import Stop
from hpop.problems.problem import Problem
from hpop.runtime.limits import Status
from hpop.world import World
from hpop.world.fields.symbols import Quadratics

OPEN = World.from_polygons([shapely.box(2.9, 1.2, 3.3, 3.0)], extent=shapely.box(0, 0, 6, 5))
PROBLEM = Problem(OPEN, DifferentialDrive(radius=0.25), (1, 2, 0), (5, 2, 0), ["exposure", "length"])
PLANNERS = {
    "epsilon-constraint": EpsilonConstraint(step=1.0, max_points=2, time_limit=600.0),
    "smoothing": Smoothing(step=1.0, time_limit=600.0),
}


class Calls:
    """Counts how often CasADi calls methods of its callbacks, and presses Ctrl-C at the one with a number."""

    def __init__(self, monkeypatch, number=None):
        self.count, self.number = 0, number
        asked = {
            Quadratics: (
                "get_n_in",
                "get_n_out",
                "get_sparsity_in",
                "get_sparsity_out",
                "has_eval_buffer",
                "eval_buffer",
            ),
            Stop: ("get_n_in", "get_n_out", "get_sparsity_in", "eval"),
        }
        for callback, methods in asked.items():
            for name in methods:
                monkeypatch.setattr(callback, name, self.counted(getattr(callback, name)))

    def counted(self, method):
        def called(callback, *arguments):
            self.count += 1
            if self.count == self.number:
                signal.raise_signal(signal.SIGINT)
            return method(callback, *arguments)

        return called


@pytest.fixture(scope="module", params=["epsilon-constraint", pytest.param("smoothing", marks=pytest.mark.proof)])
def planner(request):
    planner = PLANNERS[request.param]
    with pytest.MonkeyPatch.context() as patch:
        calls = Calls(patch)
        assert planner.solve(PROBLEM).trajectories
    return planner, calls.count


MORE = [pytest.param(share, marks=pytest.mark.proof) for share in (0.02, 0.1, 0.5, 0.9)]


@pytest.mark.parametrize("share", [0.0, pytest.param(0.01, marks=pytest.mark.proof), *MORE])
def test_ctrl_c_in_a_callback_is_ctrl_c(monkeypatch, planner, share):
    planner, count = planner
    calls = Calls(monkeypatch, 1 + int(share * count))
    with suppress(KeyboardInterrupt):  # where there is nothing to keep yet
        assert planner.solve(PROBLEM).status is Status.INTERRUPTED
    assert calls.count < count
