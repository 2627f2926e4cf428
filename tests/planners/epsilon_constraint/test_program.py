"""Polyline programs against tangents of a circle, finite differences, and the exact costs."""

import casadi
import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import Clearance, Duration, Exposure, Length, Obstruction, Rotation, Turns
from hpop.criteria.costs import trajectory_costs
from hpop.errors import OptionError, UnsupportedCriterion
from hpop.models import DifferentialDrive
from hpop.motions.symbolic import lift
from hpop.planners.programs.epsilon_constraint.program import PolylineProgram
from hpop.planners.programs.nlp import SparseField, below_hinge
from hpop.planners.programs.polyline import Polyline, PolylineStructure
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.fields.field import Field, LazyField

ROBOT = DifferentialDrive(radius=0.25)
HALF, DISC = 4.0, 1.0  # m: start and goal are this far from the centre of a disc of this radius
ROUND = World.from_polygons([shapely.Point(0, 0).buffer(DISC, quad_segs=64)], extent=shapely.box(-8, -8, 8, 8))
GOAL_FREE = Problem(ROUND, ROBOT, (-HALF, 0, 0), (HALF, 0, None), ["length"])
GOAL_AHEAD = Problem(ROUND, ROBOT, (-HALF, 0, 0), (HALF, 0, 0), ["length"])


def polyline(problem, *inner):
    return Polyline(np.array([problem.start[:2], *inner, problem.goal[:2]], float), problem.start[2], problem.goal[2])


def exact(problem, criteria, line):
    return trajectory_costs(criteria, [line.trajectory(problem.model)], problem.world)[0]


def tangent_length(clearance, segments):
    """Shortest polyline of n segments that keeps off the disc: all touch the circle, with equal angles between.

    Two tangents from start and goal, and 2 R tan(angle / 2) round each vertex.
    """
    radius = DISC + clearance
    between = (np.pi - 2 * np.arccos(radius / HALF)) / (segments - 1)
    return 2 * np.sqrt(HALF**2 - radius**2) + (segments - 1) * 2 * radius * np.tan(between / 2)


# Polylines


def test_moves_in_one_line_are_one_segment_and_turns_in_place_none():
    poses = [(-4, 0, 0), (-4, 0, np.pi / 2), (-4, 1, np.pi / 2), (-4, 2, np.pi / 2), (4, 2, 0), (4, 0, 0)]
    line = Polyline.of(Trajectory.from_poses(ROBOT, poses), GOAL_AHEAD)
    assert line.vertices.tolist() == [[-4, 0], [-4, 2], [4, 2], [4, 0]]
    assert line.structure.segments == 3
    assert line.structure.turns == 4
    again = line.trajectory(ROBOT)
    assert again.kinds == ("turn", "move", "turn", "move", "turn", "move", "turn")
    assert Polyline.of(again, GOAL_AHEAD).vertices.tolist() == line.vertices.tolist()


def test_the_ends_are_put_exactly_on_start_and_goal():
    poses = [(-4, 0, 0), (-3, 2, 1), (3, 0, 0), (4 - 1e-7, 1e-7, 0)]
    line = Polyline.of(Trajectory.from_poses(ROBOT, poses), GOAL_AHEAD)
    assert line.vertices[-1].tolist() == [4, 0]
    assert not line.structure.last_turn


def test_standing_still_is_a_polyline_too():
    there = Problem(ROUND, ROBOT, (3, 3, 0), (3, 3, 1.0), ["length"])
    line = Polyline.of(Trajectory.from_poses(ROBOT, [(3, 3, 0), (3, 3, 1.0)]), there)
    assert line.structure.segments == 0
    assert line.trajectory(ROBOT).kinds == ("turn",)


def test_turns_of_a_structure():
    assert PolylineStructure((1, 1, 1), True, True).turns == 4
    assert PolylineStructure((1,), False, False).turns == 0
    assert PolylineStructure((), False, False).turns == 0


def test_a_simplified_polyline_keeps_the_vertices_that_turn():
    line = polyline(GOAL_FREE, (-2, 2), (0, 2.01), (2, 2))
    assert line.simplified(np.deg2rad(1.0)).vertices.tolist() == [[-4, 0], [-2, 2], [2, 2], [4, 0]]
    assert line.simplified(0.0).vertices.tolist() == line.vertices.tolist()
    assert polyline(GOAL_FREE).simplified(1.0).vertices.tolist() == [[-4, 0], [4, 0]]


# Derivatives


def test_lookups_have_the_values_and_derivatives_of_casadis_own_spline():
    """A field that is sampled on demand agrees with CasADi's B-spline, which shares no code with it."""
    xs, ys = np.arange(300.0), np.arange(200.0)
    lazy = LazyField(xs, ys, 1.0, lambda x, y: np.sin(x) * np.cos(2 * y), (-1.0, 1.0))
    x, y = np.meshgrid(xs, ys)
    whole = Field(np.sin(x) * np.cos(2 * y), 1.0)
    flat, weights = casadi.MX.sym("flat", 10), casadi.MX.sym("w", 5)  # as the adjoints of a program are
    table = casadi.reshape(flat, 2, 5)
    point = np.random.default_rng(0).uniform(20, 50, size=10)
    results = []
    for field in (SparseField.of(lazy), whole):
        column = [lift(table[axis, :].T, 5) for axis in (0, 1)]
        values = casadi.vec(field(*column).to_casadi())
        hessian, gradient = casadi.hessian(casadi.dot(values * casadi.vec(table[0, :]), weights), flat)
        function = casadi.Function("f", [flat, weights], [values, gradient, casadi.densify(hessian)])
        results.append([np.array(part) for part in function(point, range(1, 6))])
    for ours, theirs in zip(*results, strict=True):
        assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-11)
    assert lazy.__dict__["_asked"].mean() < 0.1  # blocks of it that were sampled


# Programs


@pytest.mark.cases("3-1.0")
@pytest.mark.parametrize("clearance", [1.0, *(pytest.param(metres, marks=pytest.mark.proof) for metres in (0.5, 1.5))])
@pytest.mark.parametrize("segments", [2, 3])
def test_the_shortest_way_round_a_disc_is_made_of_tangents(clearance, segments):
    criteria = (Length(), Clearance(enough=2.0))
    inner = [[(0, 4.5)], [(-2, 3.2), (2, 3.2)]][segments - 2]
    line = polyline(GOAL_FREE, *inner)
    epsilon = np.array([np.inf, 2.0 - clearance])
    for _ in range(4):  # each program moves a vertex by at most a metre
        solution = PolylineProgram(GOAL_FREE, criteria, 0, line.structure).solve(line, epsilon)
        assert solution.converged, solution.status
        line = solution.polyline
    length, shortfall = exact(GOAL_FREE, criteria, line)
    assert length == pytest.approx(tangent_length(clearance, segments), rel=0.01)
    assert shortfall == pytest.approx(2.0 - clearance, abs=0.05)  # half a field cell


@pytest.mark.cases(1)
@pytest.mark.parametrize("minimise", [0, 1])
def test_no_length_is_paid_for_clearance_that_costs_nothing(minimise):
    line = polyline(GOAL_FREE, (-2, 2.2), (2, 2.2))
    nearest = 2.0 - exact(GOAL_FREE, [Clearance(enough=2.0)], line)[0]
    criteria = (Length(), Clearance(enough=nearest + 1e-4))
    before = exact(GOAL_FREE, criteria, line)
    program = PolylineProgram(GOAL_FREE, criteria, minimise, line.structure)
    solution = program.solve(line, before + np.array([1.0, 1e-3]), scale=before)
    assert solution.converged, solution.status
    after = exact(GOAL_FREE, criteria, solution.polyline)
    assert after[0] <= before[0] + 0.1
    assert after[1] <= before[1] + 1e-3


def test_the_programs_costs_are_the_exact_ones_within_its_quadrature():
    criteria = (Length(), Exposure(), Duration(), Rotation())
    line = polyline(GOAL_AHEAD, (-2, 2), (1, 2.5), (3, 1))
    program = PolylineProgram(GOAL_AHEAD, criteria, 0, line.structure)
    planned, told = program.costs(line), exact(GOAL_AHEAD, criteria, line)
    assert planned[[0, 3]] == pytest.approx(told[[0, 3]], rel=1e-9)
    assert planned[1] == pytest.approx(told[1], rel=5e-3)
    assert planned[2] == pytest.approx(told[2], rel=1e-3)  # rounded cusps of turns


def test_the_worst_sample_is_never_worse_than_the_worst_moment():
    criteria = (Length(), Clearance(enough=2.0))
    line = polyline(GOAL_FREE, (-1, 2.1), (2, 2.4))
    planned = PolylineProgram(GOAL_FREE, criteria, 0, line.structure).costs(line)[1]
    told = exact(GOAL_FREE, criteria, line)[1]
    assert told - 0.15 < planned < told + 0.082  # samples 0.3 m apart; the field is within 0.82 of a cell


def test_corrected_worst_moments_are_the_exact_ones():
    criteria = (Length(), Clearance(enough=2.0), Clearance(enough=5.0))
    line = polyline(GOAL_AHEAD, (-1, 2.1), (2, 2.4))
    program = PolylineProgram(GOAL_AHEAD, criteria, 0, line.structure)
    corrections = program.corrections(line)
    assert program.costs(line, corrections) == pytest.approx(exact(GOAL_AHEAD, criteria, line), abs=1e-4)
    assert PolylineProgram(GOAL_AHEAD, (Length(),), 0, line.structure).corrections(line) is None


def test_a_structure_grows_with_segments_that_have_become_longer():
    short, long = PolylineStructure((1, 8), True, False), PolylineStructure((3, 6), True, False)
    assert short.grown(long) == PolylineStructure((3, 8), True, False)
    assert short.grown(short) == short


def test_a_worst_moment_is_bounded_where_its_hinge_is_flat():
    """Nothing nearer than enough: the bound lies where the cost has no gradient on one side."""
    criteria = (Length(), Clearance(enough=2.0))
    line = polyline(GOAL_FREE, (-2, 3.4), (2, 3.4))
    assert exact(GOAL_FREE, criteria, line)[1] == 0
    solution = PolylineProgram(GOAL_FREE, criteria, 0, line.structure).solve(line, np.array([np.inf, 0.0]))
    assert solution.converged, solution.status
    assert solution.costs[1] == pytest.approx(0.0, abs=1e-6)
    assert exact(GOAL_FREE, criteria, solution.polyline)[0] < exact(GOAL_FREE, criteria, line)[0] - 0.2


def test_only_hinges_are_taken_away_and_conditions_stay():
    x = casadi.MX.sym("x", 3)
    column = lift(x, 3)
    point = np.array([-1.0, 0.5, 2.0])
    for before, after in (
        (np.maximum(1.0 - column, 0.0), 1.0 - point),
        (np.maximum(0.0, column), point),
        (np.where(column > 0.0, np.maximum(column - 1.0, 0.0), 0.0), [0.0, -0.5, 1.0]),
        (np.maximum(column, 1.0), np.maximum(point, 1.0)),
        (np.where(column > 0.0, column, 1.0), np.where(point > 0.0, point, 1.0)),
    ):
        below = casadi.Function("below", [x], [below_hinge(casadi.vec(casadi.MX(before)))])
        assert np.array(below(point)).ravel().tolist() == list(after)


def test_headings_without_a_turn_are_kept_exactly():
    line = polyline(GOAL_AHEAD, (-3, 0), (-1, 2.5), (1, 2.5), (3, 0))
    structure = line.structure
    assert (structure.first_turn, structure.last_turn) == (False, False)
    program = PolylineProgram(GOAL_AHEAD, (Length(), Clearance()), 0, structure)
    assert program.freedom == 6
    solution = program.solve(line, np.array([np.inf, 1.0]))
    assert solution.converged
    assert solution.polyline.structure.turns == structure.turns == 4
    assert solution.polyline.vertices[[1, -2], 1].tolist() == [0, 0]
    assert solution.polyline.lengths.sum() < line.lengths.sum()


def test_no_solution_is_worse_than_its_warm_start_in_any_bounded_cost():
    criteria = (Length(), Exposure(), Duration())
    line = polyline(GOAL_AHEAD, (-2, 2), (1, 2.5), (3, 1))
    program = PolylineProgram(GOAL_AHEAD, criteria, 1, line.structure)
    before = program.costs(line)
    solution = program.solve(line, before)
    assert solution.converged
    assert (solution.costs <= before * (1 + 1e-6)).all()
    assert solution.costs[1] < 0.98 * before[1]


def test_a_solution_is_the_same_again_and_the_program_is_built_once():
    line = polyline(GOAL_AHEAD, (-2, 2), (1, 2.5), (3, 1))
    program = PolylineProgram(GOAL_AHEAD, (Length(), Exposure()), 0, line.structure)
    built = program._built
    first, second = (program.solve(line, np.array([np.inf, 3.0])).polyline.vertices for _ in range(2))
    assert first.tolist() == second.tolist()
    assert program._built is built


def test_headings_may_leave_nothing_free():
    line = polyline(GOAL_AHEAD)
    assert PolylineProgram(GOAL_AHEAD, (Length(),), 0, line.structure).freedom == 0
    solution = PolylineProgram(GOAL_AHEAD, (Length(),), 0, line.structure).solve(line, np.array([9.0]))
    assert solution.converged
    assert solution.polyline is line


def test_a_bound_below_the_ideal_is_infeasible():
    line = polyline(GOAL_FREE, (0, 2.5))
    solution = PolylineProgram(GOAL_FREE, (Length(), Exposure()), 1, line.structure).solve(
        line, np.array([7.9, np.inf])
    )
    assert not solution.converged
    assert solution.status == "Infeasible_Problem_Detected"


def test_bounds_rise_where_a_solution_cuts_a_corner():
    line = polyline(GOAL_FREE, (0, 1.2))
    program = PolylineProgram(GOAL_FREE, (Length(),), 0, line.structure)
    bounds = program.bounds(line)
    raised = program.raised(bounds, line)
    assert any((new > old).any() for old, new in zip(bounds, raised, strict=True))
    far = polyline(GOAL_FREE, (0, 4.0))
    program = PolylineProgram(GOAL_FREE, (Length(),), 0, far.structure)
    bounds = program.bounds(far)
    for old, new in zip(bounds, program.raised(bounds, far), strict=True):
        assert new.tolist() == old.tolist()


@pytest.mark.parametrize(("criterion", "why"), [(Turns(), "'turns' has no gradient"), (Obstruction(), "time-mean")])
def test_what_has_no_gradient_or_does_not_add_up_is_refused_by_name(criterion, why):
    with pytest.raises(UnsupportedCriterion, match=why):
        PolylineProgram(GOAL_FREE, (Length(), criterion), 0, PolylineStructure((1, 1), True, False))


def test_what_is_minimised_must_be_there():
    with pytest.raises(OptionError, match="minimise"):
        PolylineProgram(GOAL_FREE, (Length(),), 1, PolylineStructure((1, 1), True, False))


@pytest.mark.proof
def test_two_segments_without_a_first_turn_may_end_with_any_heading():
    world = hpop.World.from_polygons([shapely.box(3, 2, 4, 6)], extent=shapely.box(0, 0, 10, 10))
    problem = hpop.Problem(world, hpop.DifferentialDrive(), (1, 1, 0), (9, 9, None), ["exposure", "length", "turns"])
    front = problem.solve("epsilon-constraint", step=1.0)
    assert len(front) > 0
    assert front.costs[:, 1].min() >= np.hypot(8, 8) - 1e-6
