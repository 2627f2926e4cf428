"""Deadlines reach into solvers, into what is built for them, and into the jobs of each planner of programs."""

import time
from dataclasses import replace

import casadi
import numpy as np
import pytest
import shapely

import hpop
from hpop.planners import EpsilonConstraint, Smoothing, WeightedSumCorridor
from hpop.planners.judgement import judge
from hpop.planners.programs import Deadline
from hpop.planners.programs._stop import Stop
from hpop.planners.programs.epsilon_constraint.grid import Cell, FreePolyline, Roles
from hpop.planners.programs.epsilon_constraint.job import PolylineJob
from hpop.planners.programs.epsilon_constraint.nearby import LocalModel
from hpop.planners.programs.epsilon_constraint.program import PolylineProgram
from hpop.planners.programs.polyline import Polyline
from hpop.planners.programs.smoothing.job import SmoothingJob
from hpop.planners.programs.smoothing.program import DrivenProgram
from hpop.planners.programs.smoothing.separable import Separable
from hpop.runtime.limits import LimitPassed, Status, Watch, within
from hpop.world.fields.symbols import Quadratics

WORLD = hpop.World.from_polygons([shapely.box(2.9, 1.2, 3.3, 3.0)], extent=shapely.box(0, 0, 6, 5))
PROBLEM = hpop.Problem(WORLD, hpop.DifferentialDrive(radius=0.25), (1, 2, 0), (5, 2, 0), ["turns", "length"])
OVER = Deadline(0.0)


def test_a_solver_whose_time_is_over_stops_and_says_nothing_else(capfd):
    line = Polyline(np.array([(1, 2), (3, 4), (5, 2)], float), 0.0, 0.0)
    length = tuple(c for c in PROBLEM.criteria if c.name == "length")
    assert PolylineProgram(PROBLEM, length, 0, line.structure).solve(line, np.array([np.inf])).iterations > 1
    deadline = Deadline.after(3600.0)
    program = PolylineProgram(PROBLEM, length, 0, line.structure, deadline).build()
    object.__setattr__(deadline, "until", 0.0)
    with pytest.raises(LimitPassed, match="a program was solved"), within(deadline):
        program.solve(line, np.array([np.inf]))
    assert capfd.readouterr() == ("", "")


def test_a_solver_is_stopped_before_an_iteration_that_would_end_too_late():
    now = time.monotonic()
    sizes = [casadi.DM(casadi.nlpsol_out(i) == "f", 1) for i in range(casadi.nlpsol_n_out())]
    for left, stops in ((3000.0, 0), (1000.0, 1)):
        stop = Stop(Deadline(now + left), 0, 0)
        stop.last = now - 2000.0  # an iteration as long as that
        assert int(stop(*sizes)) == stops
        assert int(Stop(Deadline(now + left), 0, 0)(*sizes)) == 0


def test_a_field_that_is_read_too_late_is_no_number():
    field = WORLD.clearance_field()
    read = Quadratics(field, 1)
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
    assert Deadline.after(None).left == np.inf
    assert Deadline.after(60.0).left == pytest.approx(60.0, abs=30.0)


@pytest.mark.parametrize("jump", [-1e6, 1e6])
def test_a_wall_clock_that_is_set_neither_ends_nor_prolongs_the_work(monkeypatch, jump):
    now, ahead, over = time.time, Deadline.after(3600.0), Deadline.after(0.0)
    monkeypatch.setattr(time, "time", lambda: now() + jump)
    assert (ahead.is_past, over.is_past) == (False, True)
    elsewhere = replace(ahead, machine="another")  # there, only the wall clock tells
    assert elsewhere.left == pytest.approx(3600.0 - jump, abs=30.0)


@pytest.mark.parametrize("planner", [EpsilonConstraint, Smoothing, WeightedSumCorridor])
def test_the_warm_starts_are_returned_where_time_ends_before_anything_else_is_there(planner):
    known = {"lattice": {"step": 1.0, "time_limit": 60.0}}
    lattice = PROBLEM.solve("lattice", step=1.0)
    found = planner(warm_start=known, time_limit=1e-6).solve(PROBLEM)
    assert found.status is Status.TIME_LIMIT
    assert "had found no path by then" in found.notes[0]
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


def over_once(monkeypatch, of, name):
    """Return a deadline that is over as soon as a method of a class is called."""
    deadline, method = Deadline.after(3600.0), getattr(of, name)

    def late(self, *arguments):
        object.__setattr__(deadline, "until", 0.0)
        return method(self, *arguments)

    monkeypatch.setattr(of, name, late)
    return deadline


def test_a_curve_is_kept_where_time_ends_while_it_is_refined(monkeypatch):
    deadline = over_once(monkeypatch, DrivenProgram, "refined")
    polyline = PROBLEM.solve("lattice", step=1.0).trajectories[0]
    outcome = SmoothingJob(PROBLEM, PROBLEM.criteria, None, 60, deadline).solve(polyline)
    assert outcome.candidate.provenance["settled"] is False
    assert judge(PROBLEM, PROBLEM.criteria, [outcome.candidate.trajectory]).reasons == ("",)


def test_a_polyline_is_kept_where_time_ends_while_its_corners_move(monkeypatch):
    deadline = over_once(monkeypatch, LocalModel, "bend")
    roles = Roles.of(PROBLEM.criteria, None, PROBLEM)
    (polyline,) = (Polyline.of(t, PROBLEM) for t in PROBLEM.solve("lattice", step=1.0).trajectories[:1])
    costs = judge(PROBLEM, roles.criteria, [polyline.trajectory(PROBLEM.model)]).costs[0]
    outcome = PolylineJob(PROBLEM, roles, 1, deadline).solve((Cell(costs, 0, 0), FreePolyline(polyline, costs)))
    assert outcome.candidate.solved.costs[roles.minimise] < costs[roles.minimise]


def test_a_tenth_of_a_limit_is_left_to_the_evaluation_of_what_is_found():
    now = time.perf_counter()
    assert Watch("jobs", 1000.0, began=now - 950.0).is_late()
    assert not Watch("jobs", 1000.0, began=now - 850.0).is_late()
    assert 40.0 < Watch("jobs", 1000.0, began=now - 850.0).left < 50.0


@pytest.mark.parametrize("planner", [EpsilonConstraint, Smoothing])
def test_warm_starts_that_were_not_improved_in_time_stay_beside_what_was_found(planner, monkeypatch):
    looks = iter([False, *[True] * 1000])
    monkeypatch.setattr(Watch, "is_late", lambda watch: next(looks))
    lattice = PROBLEM.solve("lattice", step=1.0)
    found = planner(step=1.0, time_limit=1000.0).solve(PROBLEM)
    assert found.status is Status.TIME_LIMIT
    names = sorted(origin["planner"] for origin in found.provenance)
    assert names == sorted([planner.name, *["lattice"] * (len(lattice) - 1)])
    front = PROBLEM.front(found)
    for row in lattice.costs:
        assert (front.costs <= 1.02 * row + 1e-6).all(axis=1).any()  # 2 %: what smoothing may cost more
