"""Claims: among people who move limits are kept, a first answer comes before the last, and what is wrong is told."""

import pytest

from hpop.errors import OptionError, QueryError
from hpop.planners.graph_planners import Lattice, Roadmap, WeightedSum
from hpop.planners.graphs import lattice as planner
from hpop.problems.problem import Problem
from hpop.runtime.limits import Status
from hpop.world import Person
from tests.planners.timed.rooms_with_people import ROBOT, in_the_door, through_the_doors

PROBLEM = through_the_doors(in_the_door(until=8.0), criteria=("duration", "turns", "length"))

WALKER = Person(5.0, 1.2, velocity=(-0.8, 0.3), until=5.0)
PASSING = through_the_doors(WALKER, criteria=("hall_zones", "duration", "turns"))


def test_stages_end_with_what_solve_finds():
    lattice = Lattice(step=0.5)
    *before, last = lattice.stages(PROBLEM)
    assert all(stage.status is Status.UNFINISHED for stage in before)
    assert last.status is Status.COMPLETE
    assert (last.planned == lattice.solve(PROBLEM).planned).all()


@pytest.mark.parametrize(
    ("limit", "status"),
    [
        ({"time_limit": 1e-6}, Status.TIME_LIMIT),
        ({"max_memory": 10_000}, Status.MEMORY_LIMIT),
        ({"max_labels": 20}, Status.LABEL_LIMIT),
    ],
)
def test_limits_end_it_and_are_told(limit, status):
    found = Lattice(step=0.5, **limit).solve(PASSING)
    assert found.status is status
    assert "incomplete" in found.certificate


@pytest.mark.parametrize("most", [50_000, 100_000, 400_000, 700_000, 1_000_000])
def test_whatever_runs_out_of_memory_says_what_helps(most):
    found = Lattice(step=0.5, max_memory=most).solve(PASSING)
    assert found.status is Status.MEMORY_LIMIT
    assert any("raise max_memory" in note for note in found.notes)


def test_a_search_goes_on_from_its_checkpoint_to_the_same_front(tmp_path):
    whole = Lattice(step=0.5).solve(PASSING)
    kept = str(tmp_path / "search.checkpoint")
    stopped = Lattice(step=0.5, checkpoint=kept, max_labels=20).solve(PASSING)
    assert stopped.status is Status.LABEL_LIMIT
    *_, on = Lattice(step=0.5, checkpoint=kept).stages(PASSING)
    assert on.status is Status.COMPLETE
    assert (on.planned == whole.planned).all()


def test_what_covers_within_a_factor_is_no_worse_than_that():
    exact, near = (Lattice(step=0.5, eps=eps).solve(PROBLEM) for eps in (0.0, 0.2))
    for row in exact.planned:
        assert (near.planned <= 1.2 * row + 1e-9).all(axis=1).any()
    assert "within a factor 1.2" in near.certificate


def test_turns_are_bounded():
    found = Lattice(step=0.5, max_turns=1).solve(PROBLEM)
    assert found.planned[:, 1].max() <= 1
    with pytest.raises(OptionError, match="max_turns needs the criterion 'turns'"):
        Lattice(step=0.5, max_turns=1).solve(through_the_doors(in_the_door(until=8.0)))


def test_a_mean_is_represented_by_its_integral_and_reported():
    problem = through_the_doors(WALKER, criteria=("obstruction", "hall_zones", "duration"))
    front = problem.solve(Lattice(step=0.5, eps=0.2))
    assert front.reported_names == ("obstruction",)
    assert "NOT VALID" not in front.certificate


def test_what_needs_a_world_at_rest_says_so():
    with pytest.raises(OptionError, match="max_detour needs a world without moving people"):
        Lattice(step=0.5, max_detour=1.2).solve(PROBLEM)
    with pytest.raises(
        QueryError,
        match=r"weighted-sum does not consider time.*: Ann\. Use a planner .*: exact, lattice, roadmap or any-angle",
    ):
        WeightedSum().solve(PROBLEM)


def test_the_problem_decides_how_long_people_are_predicted():
    for_ever = Person(3.0, 2.0, velocity=(0.0, 0.01), name="Ann")
    problem = through_the_doors(for_ever, horizon=6.0)
    front = problem.solve(Lattice(step=0.5))
    assert "ends after 6 s" in front.certificate
    assert any("predicted up to the horizon" in note for note in front.runs[0]["notes"])
    assert front.costs[:, 0].min() == pytest.approx(4.0)


@pytest.mark.parametrize("planner", [Lattice(step=0.5), Roadmap(samples=20)])
def test_one_who_is_at_the_goal_already_needs_no_time(planner):
    problem = Problem(PROBLEM.world, ROBOT, (1, 2, 0), (1, 2, None), ["duration"])
    found = planner.solve(problem)
    assert found.planned.tolist() == [[0.0]]
    assert len(found.trajectories[0]) == 0


def test_first_points_come_from_a_part_on_the_shortest_ways(monkeypatch):
    monkeypatch.setattr(planner, "MOST_IN_TIME", 30)
    first, last = Lattice(step=0.5).stages(PROBLEM)
    assert first.status is Status.UNFINISHED
    assert "positions on the shortest paths" in first.certificate
    assert len(first.planned) > 0
    assert last.status is Status.COMPLETE
    for row in first.planned:  # real plans: the whole lattice has all of them, or better ones
        assert (last.planned <= row + 1e-9).all(axis=1).any()


def test_who_interrupts_the_first_answer_before_its_first_plan_is_told_so(monkeypatch):
    monkeypatch.setattr(planner, "MOST_IN_TIME", 30)

    def interrupt(told):
        if told.stage != "graph":
            raise KeyboardInterrupt

    (found,) = Lattice(step=0.5).stages(PROBLEM, interrupt)
    assert found.status is Status.INTERRUPTED
    assert len(found.trajectories) == 0
    assert "incomplete (interrupted)" in found.certificate
