"""Tours improved leg by leg by nonlinear programs: stops and holds stay, and legs get better."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria.costs import trajectory_costs
from hpop.errors import OptionError
from hpop.goals import Tour
from hpop.planners.base import make_planner
from hpop.planners.programs.tour_legs import TourLegs
from hpop.problems.verify import verify
from hpop.trajectories.trajectory import Trajectory

ROBOT = hpop.DifferentialDrive(radius=0.3, camera_height=1.2)
OPEN = hpop.World.from_polygons([], extent=shapely.box(0, 0, 8, 6))
WALLED = hpop.World.from_polygons([shapely.box(3, 0, 4, 3)], extent=shapely.box(0, 0, 8, 6))
STOPS = [
    {"at": (6.5, 1.0), "within": 0.6, "dwell": 3, "name": "east"},
    {"at": (1.0, 5.0), "within": 0.6, "dwell": 2, "name": "north"},
    {"at": (5.0, 5.0), "within": 0.8, "name": "passed", "optional": True},
]
PLANNERS = ["epsilon-constraint", pytest.param("smoothing", marks=pytest.mark.proof)]


def tour_problem(world: hpop.World = WALLED, criteria: tuple[str, ...] = ("turns", "length", "stops_missed")):
    return hpop.Problem(world, ROBOT, (2, 3.5, 0), (2, 4, 0), list(criteria), tour=Tour(STOPS, order="any"))


@pytest.fixture(scope="module")
def problem() -> hpop.Problem:
    return tour_problem()


@pytest.fixture(scope="module")
def warm(problem: hpop.Problem) -> hpop.Front:
    return problem.solve("lattice", step=0.5)


def stays_as_before(trajectory: Trajectory, visits, old: Trajectory, old_visits) -> bool:
    """Return whether a trajectory has the visits of an old one, in order, at its states and for its dwells."""
    assert [visit["stop"] for visit in visits] == [visit["stop"] for visit in old_visits]
    for visit, before in zip(visits, old_visits, strict=True):
        state = old.at(np.array([before["begin"]]))
        away = np.hypot(trajectory.states.x - state.x[0], trajectory.states.y - state.y[0])
        away += np.abs(np.exp(1j * trajectory.states.yaw) - np.exp(1j * state.yaw[0]))
        assert away.min() < 1e-6
        assert visit["end"] - visit["begin"] == pytest.approx(before["end"] - before["begin"])
        if visit["end"] > visit["begin"]:
            held = trajectory.times[away < 1e-6]
            assert held.min() == pytest.approx(visit["begin"], abs=0.01)  # a curve comes to rest slowly
            assert held.max() == pytest.approx(visit["end"], abs=0.01)
    return True


@pytest.mark.parametrize("name", PLANNERS)
def test_stops_their_states_and_dwells_stay_and_the_length_falls(name, problem, warm):
    front = problem.solve(name, warm_start=warm)
    assert len(front)
    assert verify(problem, front) == []
    assert "leg by leg, visiting east, north and passed (optional) in any order" in front.certificate
    assert "NOT VALID" not in front.certificate
    length = warm.names.index("length")
    for point, origin in zip(front, front.provenance, strict=True):
        before = origin["warm_start"]
        old = warm.trajectories[before], warm.provenance[before]["visits"]
        assert stays_as_before(point.trajectory, origin["visits"], *old)
        assert (point.costs["length"] - warm.costs[before, length]) < -0.1
        assert point.costs["turns"] <= warm.costs[before, warm.names.index("turns")]
        assert point.costs["stops_missed"] == warm.costs[before, warm.names.index("stops_missed")]


def test_in_the_open_the_shortest_legs_are_straight_lines_between_the_stops():
    """The lattice has eight directions; a leg that may turn at both ends becomes the line between its ends."""
    problem = tour_problem(OPEN, ("length", "stops_missed"))
    warm = problem.solve("lattice", step=0.5)
    front = problem.solve("epsilon-constraint", warm_start=warm)
    assert len(front) == len(warm) == 2
    for point, origin in zip(front, front.provenance, strict=True):
        times = [0.0, *(visit["begin"] for visit in origin["visits"]), point.trajectory.duration]
        states = point.trajectory.at(np.array(times))
        straight = np.hypot(np.diff(states.x), np.diff(states.y)).sum()
        zigzag = warm.costs[origin["warm_start"], warm.names.index("length")]
        assert straight <= point.costs["length"] <= straight * (1 + 1e-3)
        assert point.costs["length"] < zigzag


def test_a_tour_that_is_cut_and_joined_again_is_the_tour(problem, warm):
    for trajectory, origin in zip(warm.trajectories, warm.provenance, strict=True):
        cut = TourLegs.of(trajectory, [visit["begin"] for visit in origin["visits"]])
        assert len(cut.legs) == len(origin["visits"]) + 1
        again = cut.joined(cut.legs)
        assert again.kinds == trajectory.kinds
        assert again.times == pytest.approx(trajectory.times)
        assert all(getattr(again.states, c) == pytest.approx(getattr(trajectory.states, c)) for c in ("x", "y", "yaw"))
        costs = trajectory_costs(problem.criteria, [again, trajectory], problem.world)
        assert costs[0].tolist() == costs[1].tolist()


def test_a_hold_at_the_goal_stays(problem, warm):
    held = warm.trajectories[0].with_hold(at=len(warm.trajectories[0]), seconds=4.0)
    cut = TourLegs.of(held, [visit["begin"] for visit in warm.provenance[0]["visits"]])
    again = cut.joined(cut.legs)
    assert again.kinds[-1] == "hold"
    assert again.times == pytest.approx(held.times)


@pytest.mark.proof
def test_the_warm_start_may_be_a_planner_that_visits_stops(problem):
    front = problem.solve("epsilon-constraint", warm_start={"lattice": {"step": 1.0}})
    assert len(front)
    assert verify(problem, front) == []
    with pytest.raises(hpop.errors.QueryError, match="weighted-sum-corridor cannot plan a tour"):
        problem.solve("epsilon-constraint", warm_start="weighted-sum-corridor")


def test_after_the_time_limit_legs_stay_as_they_were_and_a_note_says_so(problem, warm):
    front = problem.solve("epsilon-constraint", warm_start=warm, time_limit=0.001)
    assert "time limit" in front.status
    assert np.array_equal(front.costs, warm.costs)
    assert any("stayed as before" in note for note in front.notes)


@pytest.mark.parametrize("option", [{"epsilon": {"length": 20}}, {"divisions": 2}, {"max_points": 3}])
def test_bounds_on_whole_paths_are_refused(option, problem, warm):
    with pytest.raises(OptionError, match=f"leave out {next(iter(option))}"):
        problem.solve(make_planner("epsilon-constraint", {"warm_start": warm, **option}))


def test_people_who_move_are_refused(problem, warm):
    walker = hpop.Person(5.0, 5.0, velocity=(-0.5, 0.0))
    among = hpop.Problem(
        WALLED.with_content(people=(walker,)), ROBOT, (2, 3.5, 0), (2, 4, 0), problem.criteria, tour=problem.tour
    )
    with pytest.raises(hpop.errors.QueryError, match="epsilon-constraint on a tour does not consider time"):
        among.solve("epsilon-constraint", warm_start=list(warm.trajectories))
