"""Claims of the first stage of a roadmap beyond the plane: the ways along its guides, kept whatever stops the rest."""

from __future__ import annotations

from pathlib import Path

import pytest

from hpop.planners import Roadmap
from hpop.planners.graphs import roadmap as roadmap_planner
from hpop.planners.spending import Exhausted
from hpop.problems.verify import verify
from hpop.runtime.limits import Progress, Status
from tests.joints import Joints, problem


def stop_at_first_check(progress: Progress) -> None:
    if progress.stage == "checking":
        raise KeyboardInterrupt


def test_ctrl_c_before_the_first_edges_are_known_leaves_the_ways_along_guides() -> None:
    asked = problem(Joints(4, balls=40, radius=0.9, seed=3))
    front = asked.solve(Roadmap(samples=60), progress=stop_at_first_check)
    assert front.status == Status.INTERRUPTED
    assert len(front) > 0
    assert "guides" in front.certificate
    assert verify(asked, front) == []


def test_ways_along_guides_are_no_better_than_the_front_that_follows() -> None:
    asked = problem(Joints(4, balls=40, radius=0.9, seed=3))
    first, last = Roadmap(samples=60).stages(asked)
    assert first.status is Status.UNFINISHED
    assert all((last.planned <= costs).all(axis=1).any() for costs in first.planned)
    assert last.planned.tolist() == Roadmap(samples=60).solve(asked).planned.tolist()


def test_a_search_that_goes_on_from_a_checkpoint_has_one_stage(tmp_path: Path) -> None:
    asked = problem(Joints(4, balls=40, radius=0.9, seed=3))
    planner = Roadmap(samples=60, checkpoint=tmp_path / "kept")
    asked.solve(planner, progress=stop_at_first_check)
    assert (tmp_path / "kept").exists()
    assert [found.status.is_final for found in planner.stages(asked)] == [True]


def test_without_trees_there_is_one_stage() -> None:
    stages = list(Roadmap(samples=60, trees=0).stages(problem(Joints(4, balls=40, radius=0.9, seed=3))))
    assert [found.status.is_final for found in stages] == [True]


def test_a_limit_that_passes_after_the_guides_leaves_their_ways_to_the_planner_that_begins_with_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def too_late(*_: object) -> None:
        raise Exhausted(Status.TIME_LIMIT, "samples were drawn")

    monkeypatch.setattr(roadmap_planner, "configuration_roadmap", too_late)
    asked = problem(Joints(4, balls=40, radius=0.9, seed=3))
    found = Roadmap(samples=60).solve(asked)
    assert found.status is Status.TIME_LIMIT
    assert verify(asked, asked.front(found)) == []
    assert len(found.trajectories) > 0


def test_a_start_that_is_at_the_goal_stays_there() -> None:
    robot = Joints(3)
    front = problem(robot, goal=robot.start).solve(Roadmap(samples=30))
    assert front.costs.tolist() == [[0.0] * len(front.names)]
    assert len(front.trajectories[0]) == 0
