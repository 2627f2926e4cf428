"""The weighted-sum planner in corridors against analytic optima, brute force, and wrong questions."""

import dataclasses
import json
import math

import numpy as np
import pytest
import shapely

from hpop.base.registry import criteria
from hpop.criteria import Clearance, Length
from hpop.criteria.base import criterion
from hpop.criteria.convex import ConvexCost
from hpop.criteria.costs import trajectory_costs
from hpop.errors import CriterionError, OptionError, QueryError, UnsupportedCriterion
from hpop.models import DifferentialDrive
from hpop.planners import WeightedSumCorridor, make_planner
from hpop.planners.programs.corridor.corridor import corridors
from hpop.planners.programs.corridor.program import CorridorProgram
from hpop.planners.programs.corridor.weights import GAP, SMALL, Shared, solve_corridor
from hpop.planners.programs.polyline import Polyline
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.runtime.limits import Status, Watch
from hpop.runtime.sweep import processes
from hpop.world import World

R = 0.25
ROBOT = DifferentialDrive(radius=R, camera_height=1.2)
BLOCK = World.from_polygons([shapely.box(2, 0, 4, 3)], extent=shapely.box(0, 0, 6, 6))
OVER = Problem(BLOCK, ROBOT, (1, 1, math.pi / 2), (5, 1, None), ["length", "turns", "clearance"])
STEP = 0.5
OUTSIDE = [(1, 1), (1, 5), (5, 5), (5, 1)]  # round the block, away from it


@pytest.fixture
def beacon(monkeypatch):
    """Register a criterion of a test: the summed distance of the end of each move from (0, 2)."""
    monkeypatch.setattr(criteria, "_types", dict(criteria))

    @criterion("beacon", group="P", unit="m", aggregate="sum")
    @dataclasses.dataclass(frozen=True)
    class Beacon:
        def cost(self, m):
            end = m.base.end
            return np.hypot(end.x, end.y - 2.0) if m.kind == "move" else 0.0 * end.x

        def convex(self, path):
            import cvxpy

            return ConvexCost(cvxpy.sum(cvxpy.norm(path.vertices[1:] - np.array([[0.0, 2.0]]), 2, axis=1)), exact=True)

    return Beacon()


def only_corridor(problem, vertices):
    (corridor,), _ = corridors([Polyline(np.array(vertices, float), problem.start[2], problem.goal[2])], problem)
    return corridor


def shared(problem, criteria, weights=None):
    return Shared(problem.world, problem.model, criteria, weights, ("CLARABEL",))


# Analytic optima


def test_the_shortest_polyline_over_a_block_goes_by_the_corners_of_its_regions():
    """Left of the block, above it, right of it, each at the robot's reach: vertices at the corners."""
    problem = Problem(BLOCK, ROBOT, (1, 1, 0), (5, 1, None), ["length"])
    corridor = only_corridor(problem, OUTSIDE)
    found = solve_corridor(shared(problem, (Length(),), ()), corridor)
    least = 2 * math.hypot(1 - R, 2 + R) + 2 + 2 * R
    assert found.costs[0] == pytest.approx([least], rel=1e-6)
    assert found.polylines[0].vertices[1:3] == pytest.approx(np.array([[2 - R, 3 + R], [4 + R, 3 + R]]), abs=1e-4)


def test_a_heading_that_is_kept_keeps_the_first_segment_straight():
    """Up from (1, 1) until the diagonal to the corner is free is longer than turning first."""
    problem = Problem(BLOCK, ROBOT, (1, 1, math.pi / 2), (5, 1, None), ["length"])
    found = solve_corridor(shared(problem, (Length(),), ()), only_corridor(problem, OUTSIDE))
    assert found.polylines[0].vertices[1][0] == pytest.approx(1.0, abs=1e-12)
    assert found.costs[0] == pytest.approx([2 + R + 3 + R + math.hypot(1 - R, 2 + R)], rel=1e-6)
    trajectory = found.polylines[0].trajectory(ROBOT)
    assert trajectory.kinds[0] == "move"


def test_the_front_of_length_and_a_beacon_is_that_of_fermats_point(beacon):
    """One free vertex (0, y): length 2 sqrt(1 + y²) against |g - b| + 2 - y, least where its slope is w2 / w1."""
    world = World.from_polygons([], extent=shapely.box(-5, -4, 5, 6))
    problem = Problem(world, ROBOT, (-1, 0, 0), (1, 0, None), [beacon, "length"])
    corridor = only_corridor(problem, [(-1, 0), (0, 1), (1, 0)])
    rows = ((0.7, 0.3), (0.5, 0.5), (0.3, 0.7))
    found = solve_corridor(shared(problem, (Length(), beacon), rows), corridor)
    ideal, nadir = np.array([2, math.sqrt(5)]), np.array([2 * math.sqrt(5), math.sqrt(5) + 2])
    assert found.ideal == pytest.approx(ideal, abs=1e-3)
    assert found.nadir == pytest.approx(nadir, abs=1e-3)
    for row in rows:
        w = (np.array(row) + SMALL) / (found.nadir - found.ideal)
        s = w[1] / w[0] / 2
        y = min(2.0, s / math.sqrt(1 - s * s)) if s < 1 else 2.0
        (i,) = (i for i, given in enumerate(found.weights) if any(np.allclose(g, row) for g in given))
        assert found.costs[i] == pytest.approx([2 * math.sqrt(1 + y * y), math.sqrt(5) + 2 - y], abs=1e-4)
    adaptive = solve_corridor(shared(problem, (Length(), beacon)), corridor)
    Y = np.array(adaptive.costs)
    y = math.sqrt(5) + 2 - Y[:, 1]
    assert Y[:, 0] == pytest.approx(2 * np.sqrt(1 + y * y), abs=1e-4)
    # no weighted sum on the true front is better than the points by more than the gap of the dichotomy
    every = np.linspace(0, 2, 1001)
    front = np.stack([2 * np.sqrt(1 + every**2), math.sqrt(5) + 2 - every], axis=1)
    for share in np.linspace(0.01, 0.99, 99):
        w = np.array([share, 1 - share]) / (nadir - ideal)
        assert (Y @ w).min() <= (front @ w).min() + GAP + 1e-3


def test_length_against_clearance_over_a_block_is_not_below_the_taut_string_and_near_it():
    """Taut strings round the top of a block at distance c: two tangents, two arcs, and its width."""
    world = World.from_polygons([shapely.box(-1, -3, 1, 0)], extent=shapely.box(-12, -8, 12, 12))
    start, height = 6.0, 0.5
    problem = Problem(
        world, ROBOT, (-start, height, 0), (start, height, None), ["length", {"clearance": {"enough": 2}}]
    )
    front = problem.solve("weighted-sum-corridor", step=0.5)
    c = 2 - front.costs[:, 1]
    far, down = math.hypot(start - 1, height), math.atan2(height, start - 1)
    arc = np.maximum(np.arcsin(c / far) - down, 0.0)
    string = np.where(c > height, 2 * (np.sqrt(far**2 - c**2) + c * arc) + 2, 2 * start)
    assert (front.costs[:, 0] >= string - 1e-6).all()
    assert front.costs[:, 0].min() == pytest.approx(2 * start)
    assert (c.min(), c.max()) == pytest.approx((height, 2), abs=1e-3)
    # the bound of the clearance is tangent near the lattice's paths, and loose elsewhere
    assert (front.costs[:, 0] <= 1.1 * string).all()
    lattice = problem.solve("lattice", step=0.5)
    for length, shortfall in lattice.costs:
        assert (front.costs <= (length * 1.001, shortfall + 1e-3)).all(axis=1).any()


def test_no_vertex_of_the_overlap_is_better_for_the_weights():
    """One free vertex: a grid over its overlap, with the costs by their own formulas."""
    wall = World.from_polygons([shapely.box(2.9, 0, 3.1, 2)], extent=shapely.box(0, 0, 6, 6))
    problem = Problem(wall, ROBOT, (1, 1, 0), (5, 1.5, None), ["length"])
    corridor = only_corridor(problem, [(1, 1), (3, 4), (5, 1.5)])
    costs = (Length(), Clearance(enough=2.0))
    program = CorridorProgram(corridor, costs, wall, ROBOT, ("CLARABEL",))
    (x_min, y_min), (x_max, y_max) = corridor.overlaps[0].corners.min(axis=0), corridor.overlaps[0].corners.max(axis=0)
    x, y = (c.ravel() for c in np.meshgrid(np.linspace(x_min, x_max, 20), np.linspace(y_min, y_max, 20)))
    points = np.stack([x, y], axis=1)
    points = points[corridor.overlaps[0].excess(points) <= 0]
    assert len(points) > 75
    for share in (0.05, 0.5, 0.95):
        w = np.array([share, 1 - share])
        vertices = program.solve(w)
        assert vertices is not None
        assert corridor.overlaps[0].excess(vertices[1][None])[0] <= 1e-9
        every = np.array([program.evaluate(np.array([(1, 1), p, (5, 1.5)])) for p in points])
        lengths = np.hypot(*(points - (1, 1)).T) + np.hypot(*(points - (5, 1.5)).T)
        assert every[:, 0] == pytest.approx(lengths)
        assert w @ program.evaluate(vertices) <= (every @ w).min() + 1e-6


# The program


def test_the_program_is_parametrised_and_compiled_once():
    program = CorridorProgram(only_corridor(OVER, OUTSIDE), (Length(), Clearance()), BLOCK, ROBOT, ("CLARABEL",))
    assert program.problem.is_dpp()
    assert [p.name() for p in program.problem.parameters()] == ["weights"]
    program.compile()
    compiled = program.problem._cache.param_prog
    assert compiled is not None
    found = [program.solve(np.array(w)) for w in ((1.0, 0.1), (0.1, 1.0))]
    assert program.problem._cache.param_prog is compiled
    assert np.abs(found[0] - found[1]).max() > 0.1


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2])
def test_what_a_solver_leaves_of_its_tolerance_is_taken_back(yaw):
    """Vertices a micrometre off come back into the overlaps, and onto the ray of a heading that is kept."""
    problem = Problem(BLOCK, ROBOT, (1, 1, yaw), (5, 1, None), ["length"])
    corridor = only_corridor(problem, OUTSIDE)
    program = CorridorProgram(corridor, (Length(),), BLOCK, ROBOT, ("CLARABEL",))
    exact = program.solve(np.array([1.0]))
    back = program._inside(exact + 1e-6 * np.random.default_rng(0).normal(size=exact.shape))
    assert np.abs(back - exact).max() < 1e-5
    for overlap, vertex in zip(corridor.overlaps, back[1:-1], strict=True):
        assert overlap.excess(vertex[None])[0] <= 1e-12
    assert (abs(back[1, 0] - 1.0) < 1e-12) == (yaw > 0)


def test_a_form_that_is_not_convex_is_named():
    class Wrong(Length):
        def convex(self, path):
            return ConvexCost(-path.length, exact=True)

    program = CorridorProgram(only_corridor(OVER, OUTSIDE), (Wrong(),), BLOCK, ROBOT, ("CLARABEL",))
    with pytest.raises(CriterionError, match=r"convex\(\) of criterion 'length' must return .* convex by the rules"):
        program.compile()


# The planner


@pytest.fixture(scope="module")
def over():
    return WeightedSumCorridor(step=STEP).solve(OVER)


@pytest.mark.proof
def test_candidates_are_what_they_claim(over):
    assert over.status is Status.COMPLETE
    assert [c.name for c in over.objectives] == ["length", "turns", "clearance"]
    front = OVER.front(over)
    assert len(front) > 5
    assert verify(OVER, front) == []
    assert "NOT VALID" not in front.certificate
    assert "supported points, to solver tolerance, of the convex problems in (length, clearance)" in over.certificate
    assert "clearance represented by an upper bound" in over.certificate
    costs = trajectory_costs(over.objectives, over.trajectories, BLOCK)
    assert costs[:, 0] == pytest.approx(over.planned[:, 0], rel=1e-9)
    assert (costs[:, 1] == over.planned[:, 1]).all()
    assert (costs[:, 2] <= over.planned[:, 2] + 1e-9).all()
    json.dumps([over.provenance, over.stats])
    assert over.stats["dropped"] == {}
    assert over.stats["weights_solved"] == over.stats["solvers"]["CLARABEL"]
    for found in over.provenance:
        assert found["criteria"] == ["length", "clearance"]
        assert all(sum(w) == pytest.approx(1) for w in found["weights"])


def test_it_is_no_worse_than_the_warm_starts_in_length_and_shorter_than_any(over):
    lattice = OVER.solve("lattice", step=STEP)
    least = {int(n): lattice.costs[lattice.costs[:, 1] <= n, 0].min() for n in lattice.costs[:, 1]}
    for turns, length in least.items():
        assert over.planned[over.planned[:, 1] <= turns, 0].min() <= length + 1e-6
    string = 2 + 2 * math.hypot(1, 2)  # round the block itself, as a point could
    assert string < over.planned[:, 0].min() < lattice.costs[:, 0].min() - 0.1


def test_joined_with_the_lattice_nothing_gets_worse(over):
    lattice = OVER.solve("lattice", step=STEP)
    joined = lattice | OVER.front(over)
    for row in lattice.integers:
        assert (joined.integers <= row).all(axis=1).any()
    assert {p["planner"] for p in joined.provenance} >= {"weighted-sum-corridor"}


@pytest.mark.cases("options0")
@pytest.mark.parametrize("options", [{"divisions": 3}, {"weights": [[1, 0], [2, 1], [1, 2], [0, 1]]}])
def test_weights_may_be_given(options):
    found = WeightedSumCorridor(step=STEP, **options).solve(OVER)
    for corridor in range(found.stats["corridors"]):
        rows = [w for p in found.provenance if p["corridor"] == corridor for w in p["weights"]]
        assert np.array(sorted(rows)) == pytest.approx(np.array([[i / 3, 1 - i / 3] for i in range(4)]))
    assert len(found.stats["ideal"]) == len(found.stats["nadir"]) == found.stats["corridors"]


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.proof)])
def test_processes_find_the_same(over, workers):
    with processes(workers) as pool:
        again = WeightedSumCorridor(step=STEP).solve(OVER, executor=pool)
    assert again.provenance == over.provenance
    assert again.planned.tolist() == over.planned.tolist()


def test_start_is_goal():
    problem = Problem(BLOCK, ROBOT, (1, 1, 0), (1, 1, math.pi / 2), ["length", "turns", "clearance"])
    front = problem.solve("weighted-sum-corridor", step=STEP)
    assert front.costs == pytest.approx(np.array([[0.0, 1.0, 0.0]]))


def test_a_solver_that_cannot_is_replaced_and_that_is_said():
    """OSQP solves quadratic programs, a length is a second-order cone."""
    found = WeightedSumCorridor(step=STEP, solver="OSQP", weights=[[1, 1]]).solve(OVER)
    assert set(found.stats["solvers"]) == {"CLARABEL"}
    assert sum(found.stats["failed"].values()) == found.stats["weights_solved"]
    assert any(n.startswith("a solver failed: OSQP") and "CLARABEL solved" in n for n in found.notes)
    assert len(found.trajectories)


def test_what_no_solver_solves_is_counted(monkeypatch):
    monkeypatch.setattr("hpop.planners.programs.corridor.solvers_from", lambda first: ("OSQP",))
    found = WeightedSumCorridor(step=STEP, solver="OSQP").solve(OVER)
    assert any("no other solver succeeded" in note for note in found.notes)
    assert any(note.endswith("convex programs were solved by none of the installed solvers") for note in found.notes)


def test_what_collides_is_dropped_and_counted(monkeypatch):
    """A solver that goes straight through the block."""

    def through(program, weights):
        return program.base[[0, *[-1] * (len(program.base) - 1)]]

    monkeypatch.setattr(CorridorProgram, "solve", through)
    monkeypatch.setattr(CorridorProgram, "tidied", lambda program, vertices, weights: vertices)
    found = WeightedSumCorridor(step=STEP).solve(OVER)
    assert found.trajectories == ()
    assert list(found.stats["dropped"]) == ["collides"]
    assert any("candidates were rejected" in note for note in found.notes)


def test_what_costs_more_than_its_upper_bound_is_dropped_and_counted(monkeypatch):
    bound = Clearance.convex
    problem = dataclasses.replace(OVER, criteria=("length", {"clearance": {"enough": 3.0}}))
    half = lambda criterion, path: ConvexCost(0.6 * bound(criterion, path).expression, exact=False)  # noqa: E731
    monkeypatch.setattr(Clearance, "convex", half)
    candidates = WeightedSumCorridor(step=STEP).solve(problem)
    assert candidates.trajectories == ()
    assert list(candidates.stats["dropped"]) == ["exceeds the bound on clearance"]


def test_ctrl_c_keeps_what_is_finished(over):
    def progress(p):
        if p.stage == "corridors" and p.labels == 2:
            raise KeyboardInterrupt

    found = WeightedSumCorridor(step=STEP).solve(OVER, progress)
    assert found.status is Status.INTERRUPTED
    assert {p["corridor"] for p in found.provenance if p["planner"] == found.stats["planner"]} == {0, 1}
    assert f"through 2 corridors (of {over.stats['corridors']})" in found.certificate
    assert any(note.startswith("interrupted:") for note in found.notes)


def test_time_that_runs_out_is_said(monkeypatch):
    looks = iter([False, True])
    monkeypatch.setattr(Watch, "is_late", lambda watch: next(looks))
    found = WeightedSumCorridor(step=STEP, time_limit=100.0).solve(OVER)
    assert found.status is Status.TIME_LIMIT
    assert {p["corridor"] for p in found.provenance if p["planner"] == found.stats["planner"]} == {0}
    assert any(note.startswith("time limit:") for note in found.notes)


# What it refuses


@pytest.mark.parametrize(
    ("names", "match"),
    [
        (["exposure", "length"], "'exposure' is not declared convex.*'epsilon-constraint'"),
        (["obstruction", "length"], "'exposure' is not declared convex"),
        (["duration", "length"], "'duration' is not declared convex"),
        (["orientation_retention", "length"], "'orientation_retention' is not declared convex.*planner 'lattice'"),
        (["turns"], "needs a convex criterion"),
    ],
)
def test_what_is_not_convex_is_refused_by_name(names, match):
    with pytest.raises(UnsupportedCriterion, match=match):
        WeightedSumCorridor(step=STEP).solve(Problem(BLOCK, ROBOT, (1, 1, 0), (5, 1, 0), names))


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"divisions": 0}, "divisions"),
        ({"divisions": 3, "weights": [[1, 1]]}, "not both"),
        ({"weights": []}, "must be a list of weight vectors"),
        ({"weights": [[0, 0]]}, "at least one number above 0"),
        ({"weights": [[-1, 2]]}, "a weight must be a number of at least 0, got -1"),
        ({"step": 0.0}, "step"),
        ({"headings": 5}, "headings"),
        ({"time_limit": 0.0}, "time_limit"),
        ({"warm_start": {"lattice": {}, "other": {}}}, "warm_start"),
        ({"warm_start": {"lattice": {"size": 1}}}, "no option 'size'"),
        ({"warm_start": 3}, "warm_start"),
        ({"solver": "GUROBY"}, "CLARABEL.*got 'GUROBY'"),
    ],
)
def test_wrong_options_are_refused(options, match):
    with pytest.raises(OptionError, match=match):
        make_planner("weighted-sum-corridor", options)


def test_weights_that_are_not_one_a_convex_cost_are_refused():
    with pytest.raises(OptionError, match=r"numbers, for .* in this order; got 3 numbers"):
        WeightedSumCorridor(step=STEP, weights=[[1, 1, 1]]).solve(OVER)


def test_no_path_is_said():
    wall = World.from_polygons([shapely.box(2, 0, 4, 6)], extent=shapely.box(0, 0, 6, 6))
    found = WeightedSumCorridor(step=STEP).solve(Problem(wall, ROBOT, (1, 1, 0), (5, 1, 0), ["length"]))
    assert found.status is Status.NO_PATH
    assert found.trajectories == ()
    assert any("no warm start" in note for note in found.notes)


def test_a_start_in_collision_is_refused():
    with pytest.raises(QueryError, match="start"):
        WeightedSumCorridor(step=STEP).solve(Problem(BLOCK, ROBOT, (3, 1, 0), (5, 1, 0), ["length"]))
