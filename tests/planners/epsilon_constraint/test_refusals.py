"""Refusals of epsilon-constraint, and its message when no path exists."""

import dataclasses
import math

import casadi
import pytest
import shapely

from hpop.errors import HpopWarning, OptionError, QueryError, UnsupportedCriterion
from hpop.models import DifferentialDrive
from hpop.planners import EpsilonConstraint, Lattice, make_planner
from hpop.planners.programs.epsilon_constraint.grid import least_length
from hpop.problems.problem import Problem
from hpop.runtime.limits import Status
from hpop.world import World

ROBOT = DifferentialDrive(radius=0.25)
OPEN = World.from_polygons([shapely.box(2.9, 1.2, 3.3, 3.0)], extent=shapely.box(0, 0, 6, 5))
PAPER = Problem(OPEN, ROBOT, (1, 2, 0), (5, 2, 0), ["exposure", "turns", "length"])


def test_a_cost_that_no_structure_settles_is_refused_by_name():
    problem = Problem(OPEN, ROBOT, (1, 2, 0), (5, 2, 0), ["orientation_retention", "length"])
    with pytest.raises(UnsupportedCriterion, match=r"'orientation_retention' has no gradient.*planner 'lattice'"):
        EpsilonConstraint(step=0.5).solve(problem)


def test_nothing_to_minimise():
    problem = Problem(OPEN, ROBOT, (1, 2, 0), (5, 2, 0), ["turns"])
    with pytest.raises(UnsupportedCriterion, match="smooth criterion to minimise"):
        EpsilonConstraint(step=0.5).solve(problem)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"divisions": -1}, "divisions"),
        ({"divisions": 1.5}, "divisions"),
        ({"divisions": True}, "divisions"),
        ({"divisions": 10**9}, "divisions must be a whole number from 0 to 1,000"),
        ({"rounds": 0}, "rounds"),
        ({"epsilon": {"length": True}}, "epsilon"),
        ({"warm_start": {"lattice": 5}}, r"options of 'lattice' as \{option: value\}"),
        ({"max_points": 0}, "max_points"),
        ({"step": 0.0}, "step"),
        ({"headings": 5}, "headings"),
        ({"time_limit": 0.0}, "time_limit"),
        ({"epsilon": {"length": "x"}}, "epsilon"),
        ({"epsilon": 3.0}, "epsilon"),
        ({"epsilon": {"length": -1}}, "epsilon of length must be a number of at least 0"),
        ({"epsilon": {"length": math.nan}}, "epsilon of length must be a number of at least 0"),
        ({"warm_start": {"lattice": {}, "other": {}}}, "warm_start"),
        ({"warm_start": {"lattice": {"size": 1}}}, "no option 'size'"),
    ],
)
def test_wrong_options_are_refused(options, match):
    with pytest.raises(OptionError, match=match):
        make_planner("epsilon-constraint", options)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"minimise": "time"}, "time"),
        ({"minimise": "turns"}, "smooth"),
        ({"epsilon": {"depth": 1.0}}, "depth"),
        ({"minimise": "lenght"}, r"got 'lenght'\. Did you mean 'length'\?"),
        (
            {"epsilon": {"lenght": 9.0, 3: 1.0}},
            r"epsilon must bound criteria by their names, got 3, lenght\. Did you mean 'length'\?",
        ),
    ],
)
def test_costs_that_are_not_there_are_refused(options, match):
    with pytest.raises(OptionError, match=match):
        EpsilonConstraint(step=0.5, **options).solve(PAPER)


def test_a_bound_on_a_mean_is_refused_with_what_stands_in_for_it():
    problem = dataclasses.replace(PAPER, criteria=["obstruction", "turns", "length"])
    with pytest.raises(
        OptionError, match=r"is planned instead: bound exposure. The criteria are exposure, turns, length"
    ):
        EpsilonConstraint(step=0.5, epsilon={"obstruction": 0.1}).solve(problem)


def test_an_epsilon_below_the_ideal_is_told_before_programs_run_and_is_infeasible_and_says_so():
    with pytest.warns(HpopWarning, match=r"epsilon bounds exposure by 0.01, but the best warm start has"):
        candidates = EpsilonConstraint(step=0.5, epsilon={"exposure": 0.01}, max_points=1).solve(PAPER)
    assert candidates.trajectories == ()
    ideal = Lattice(step=0.5).solve(PAPER).planned[:, 0].min()
    begin = "no polyline was found within epsilon {'exposure': 0.01}: the least costs of the warm starts are exposure "
    (said,) = [note.removeprefix(begin) for note in candidates.notes if note.startswith(begin)]
    assert float(said.removesuffix(" s")) == pytest.approx(ideal, rel=1e-3)
    assert any("infeasible" in note for note in candidates.notes)
    assert sum(candidates.stats["failed"].values()) > 0


def test_an_epsilon_below_the_shortest_way_round_obstacles_is_refused_at_once(monkeypatch):
    monkeypatch.setattr(Lattice, "stages", None)
    with pytest.raises(OptionError, match=r"bounds length by 3.9 m, but every trajectory .* at least 4.58\d* m"):
        EpsilonConstraint(step=0.5, epsilon={"length": 3.9}).solve(PAPER)
    to_any = dataclasses.replace(PAPER, goal=(5, 2, None))
    with pytest.raises(OptionError, match=r"at least 4.58\d* m"):
        EpsilonConstraint(step=0.5, epsilon={"length": 3.9}).solve(to_any)


def test_the_least_length_is_that_of_the_taut_way_round_an_obstacle():
    """Two tangents to circles about the corners of the box, arcs of these, and its side in between."""
    taut = 3.3 - 2.9
    for (x, y), (a, b) in (((1, 2), (2.9, 1.2)), ((5, 2), (3.3, 1.2))):
        apart = math.hypot(x - a, y - b)
        turned = math.atan2(y - b, abs(x - a)) + math.asin(0.25 / apart)
        taut += math.sqrt(apart**2 - 0.25**2) + 0.25 * turned
    assert taut - 1e-2 < least_length(PAPER) <= taut
    assert least_length(PAPER) < PAPER.solve("any-angle", step=0.5).costs[:, 2].min()
    assert least_length(dataclasses.replace(PAPER, goal=(1, 4, 0))) == 2.0


@pytest.mark.proof
def test_an_epsilon_that_can_be_kept_is_kept():
    front = PAPER.solve("epsilon-constraint", step=1.0, epsilon={"turns": 4}, max_points=4)
    assert len(front)
    assert (front.costs[:, front.names.index("turns")] <= 4).all()


def test_no_path_is_said():
    wall = World.from_polygons([shapely.box(2.9, 0, 3.3, 5)], extent=shapely.box(0, 0, 6, 5))
    candidates = EpsilonConstraint(step=0.5).solve(Problem(wall, ROBOT, (1, 2, 0), (5, 2, 0), ["length"]))
    assert candidates.status is Status.NO_PATH
    assert candidates.trajectories == ()
    assert any("no warm start" in note for note in candidates.notes)


def test_a_start_in_collision_is_refused_as_by_the_lattice():
    problem = Problem(OPEN, ROBOT, (3.1, 2, 0), (5, 2, 0), ["length"])
    said = []
    for planner in (Lattice(step=0.5), EpsilonConstraint(step=0.5)):
        with pytest.raises(QueryError, match="start") as refused:
            planner.solve(problem)
        said.append(str(refused.value))
    assert said[0] == said[1]


def test_a_missing_solver_is_said_with_what_to_do(monkeypatch):
    monkeypatch.setattr(casadi, "has_nlpsol", lambda name: name != "ipopt")
    with pytest.raises(OptionError, match=r"IPOPT.*install.*or use planner 'lattice'"):
        EpsilonConstraint(step=0.5).solve(PAPER)


@pytest.mark.cases(1)
@pytest.mark.parametrize("criteria", [["passing_distance", "turns"], ["passing_distance", "net_misalignment"]])
def test_the_only_smooth_cost_may_be_a_worst_moment_of_nobody(criteria):
    """The room is empty: every polyline costs nothing."""
    world = World.from_polygons([shapely.box(2.9, 1.2, 3.3, 3.0)], extent=shapely.box(0, 0, 6, 5))
    problem = Problem(world, DifferentialDrive(radius=0.25), (1, 2, 0.3), (5, 2, 1.5), criteria)
    candidates = EpsilonConstraint(step=1.0, max_points=2).solve(problem)
    assert (candidates.planned[:, 0] == 0.0).all()
