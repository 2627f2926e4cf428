"""Deadlines reach into solvers, into what is built for them, and into the jobs of each planner of programs."""

import time

import casadi
import numpy as np
import pytest
import shapely

import hpop
from hpop.limits import LimitPassed, within
from hpop.planners import EpsilonConstraint, Smoothing, WeightedSumCorridor
from hpop.planners.epsilon_constraint.program import PolylineProgram
from hpop.planners.polylines.polyline import Polyline
from hpop.planners.programs._stop import Stop
from hpop.planners.programs.deadline import Deadline
from hpop.planners.smoothing.separable import Separable
from hpop.status import Status
from hpop.world.looks import quadratics

WORLD = hpop.World.from_polygons([shapely.box(2.9, 1.2, 3.3, 3.0)], extent=shapely.box(0, 0, 6, 5))
PROBLEM = hpop.Problem(WORLD, hpop.DifferentialDrive(radius=0.25), (1, 2, 0), (5, 2, 0), ["turns", "length"])
OVER = Deadline(0.0)


def test_a_solver_whose_time_is_over_stops_and_says_nothing_else(capfd):
    line = Polyline(np.array([(1, 2), (3, 4), (5, 2)], float), 0.0, 0.0)
    length = tuple(c for c in PROBLEM.criteria if c.name == "length")
    assert PolylineProgram(PROBLEM, length, 0, line.structure).solve(line, np.array([np.inf])).iterations > 1
    deadline = Deadline.after(3600.0)
    program = PolylineProgram(PROBLEM, length, 0, line.structure, deadline).build()
    object.__setattr__(deadline, "at", 0.0)
    with pytest.raises(LimitPassed, match="a program was solved"), within(deadline):
        program.solve(line, np.array([np.inf]))
    assert capfd.readouterr() == ("", "")


def test_a_solver_is_stopped_before_an_iteration_that_would_end_too_late():
    now = time.time()
    sizes = [casadi.DM(casadi.nlpsol_out(i) == "f", 1) for i in range(casadi.nlpsol_n_out())]
    for left, stops in ((3000.0, 0), (1000.0, 1)):
        stop = Stop(Deadline(now + left), 0, 0)
        stop.last = now - 2000.0  # an iteration as long as that
        assert int(stop(*sizes)) == stops
        assert int(Stop(Deadline(now + left), 0, 0)(*sizes)) == 0


def test_a_field_that_is_read_too_late_is_no_number():
    field = WORLD.clearance_field()
    read = quadratics(field, 1)
    assert np.isfinite(read([3.0, 4.0]).full()).all()
    with within(OVER):
        assert np.isnan(read([3.0, 4.0]).full()).all()


def test_a_program_is_not_built_further_once_the_time_is_over():
    x, p = casadi.MX.sym("x", 4), casadi.MX.sym("p", 2, 1)
    where = np.arange(4).reshape(2, 2)
    with pytest.raises(LimitPassed, match="a program was built"):
        Separable.of(lambda z, q: [casadi.vertcat(z[0] * z[1] * q[0])], where, x, p, OVER)


def test_what_nothing_interrupts_is_not_begun_where_it_would_end_too_late():
    Deadline.after(60.0).check("it was done", ahead=30.0)
    with pytest.raises(LimitPassed, match="it was done"):
        Deadline.after(60.0).check("it was done", ahead=90.0)
    assert Deadline.after(None).at is None
    assert Deadline.after(60.0).at == pytest.approx(time.time() + 60.0, abs=30.0)


@pytest.mark.parametrize("planner", [EpsilonConstraint, Smoothing, WeightedSumCorridor])
def test_the_warm_starts_are_returned_where_time_ends_before_anything_else_is_there(planner):
    known = {"lattice": {"step": 1.0, "time_limit": 60.0}}
    lattice = PROBLEM.solve("lattice", step=1.0)
    found = planner(warm_start=known, time_limit=1e-6).solve(PROBLEM)
    assert found.status is Status.TIME_LIMIT
    assert "found nothing until then" in found.notes[0]
    front = PROBLEM.front(found)
    assert front.costs.tolist() == lattice.costs.tolist()
    assert "NOT VALID" not in front.certificate


def test_a_corridor_ends_between_two_weights():
    whole = WeightedSumCorridor(step=1.0, divisions=4, weights=None).solve(PROBLEM)
    assert whole.status is Status.COMPLETE
    paths = PROBLEM.solve("lattice", step=1.0).trajectories
    late = WeightedSumCorridor(warm_start=list(paths), time_limit=1e-9).solve(PROBLEM)
    assert late.status is Status.TIME_LIMIT
    assert late.trajectories == ()
