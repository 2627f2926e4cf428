"""Further criteria on a front that exists: the same numbers as of each trajectory, reported, claimed for nothing."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import Length
from hpop.criteria.base import make_criterion
from hpop.errors import CriterionError, QueryError, UnknownName
from hpop.problems.verify import verify
from hpop.world.content.content import Landmark

WORLD = hpop.World.from_polygons([shapely.box(2, 0, 3, 2.2)], extent=shapely.box(0, 0, 5, 4))
ALSO = ["sickness", "msdv", {"worst_obstruction": {"radius": 1.0}}, "rotation", "mean_heading_mismatch"]
NAMES = ("sickness", "msdv", "worst_obstruction", "rotation", "mean_heading_mismatch")


@pytest.fixture(scope="module")
def problem() -> hpop.Problem:
    asked = ["obstruction", "turns", "length"]
    return hpop.Problem(WORLD, hpop.DifferentialDrive(radius=0.2), (1, 1, 0), (4, 1, None), asked)


@pytest.fixture(scope="module")
def front(problem: hpop.Problem) -> hpop.Front:
    return problem.solve(step=0.5)


@pytest.fixture(scope="module")
def more(problem: hpop.Problem, front: hpop.Front) -> hpop.Front:
    return problem.evaluate(front, also=ALSO)


def test_further_columns_are_what_each_trajectory_costs(
    problem: hpop.Problem, front: hpop.Front, more: hpop.Front
) -> None:
    """Sums, means, worst moments and criteria with memory; evaluated one trajectory at a time."""
    assert more.reported_names == ("obstruction", *NAMES)
    assert more.reported_units == ("1", *(make_criterion(spec).unit for spec in ALSO))
    assert len(front) > 3
    for point in more:
        alone = problem.evaluate(point.trajectory, also=ALSO)
        assert list(alone) == ["obstruction", "turns", "length", *NAMES]
        for name in NAMES:
            assert point.reported[name] == pytest.approx(alone[name], rel=1e-12)
        own = replace(problem, criteria=ALSO).evaluate(point.trajectory)  # asked for as any other criterion
        assert own == {name: alone[name] for name in NAMES}


def test_the_points_stay_and_the_certificate_says_that_no_more_is_claimed(front: hpop.Front, more: hpop.Front) -> None:
    assert np.array_equal(more.costs, front.costs)
    assert more.names == front.names
    assert more.trajectories == front.trajectories
    assert more.certificate == f"{front.certificate}; {', '.join(NAMES)} evaluated on what was found, not optimised"
    assert (more.status, more.runs, more.notes) == (front.status, front.runs, front.notes)


def test_each_statement_of_a_joint_certificate_says_so(problem: hpop.Problem, front: hpop.Front) -> None:
    joint = problem.evaluate(replace(front, certificate="exact | supported"), also=["jerk"])
    said = "jerk evaluated on what was found, not optimised"
    assert joint.certificate == f"exact; {said} | supported; {said}"


def test_what_is_there_is_not_evaluated_again(problem: hpop.Problem, front: hpop.Front, more: hpop.Front) -> None:
    assert problem.evaluate(front) is front
    assert problem.evaluate(front, also=["turns", {"obstruction": {"radius": 2}}, "exposure", Length()]) is front
    assert problem.evaluate(more, also=ALSO) is more
    again = problem.evaluate(more, also=["jerk", "sickness"])
    assert again.reported_names == ("obstruction", *NAMES, "jerk")
    assert problem.evaluate(front.trajectories[0], also=["turns"]) == problem.evaluate(front.trajectories[0])


def test_it_serves_parts_and_choices_as_any_reported_value(problem: hpop.Problem, more: hpop.Front) -> None:
    least = more.nearest({"sickness": 0})
    assert least.reported["sickness"] == more.reported[:, 1].min()
    part = more.where(sickness=f"<={float(np.median(more.reported[:, 1]))!r}")
    assert 0 < len(part) < len(more)
    assert verify(problem, part) == []
    none = problem.evaluate(more[:0], also=["jerk"])
    assert (len(none), none.reported_names[-1]) == (0, "jerk")


def test_saved_it_is_verified_with_its_further_columns(problem: hpop.Problem, more: hpop.Front, tmp_path: Path) -> None:
    more.save(tmp_path / "front.json")
    again = hpop.Front.load(tmp_path / "front.json")
    rebuilt = hpop.Problem.from_description(again.problem or {})
    assert verify(rebuilt, again) == []
    assert rebuilt.describe() == problem.describe()
    assert len(again | more) == len(more)
    forged = replace(again, reported=again.reported + np.eye(len(again), 6)[:, ::-1] * 0.5)
    assert [fault.partition(" is saved")[0] for fault in verify(rebuilt, forged)] == [
        f"trajectory {i}: {name}" for i, name in enumerate(reversed(("obstruction", *NAMES)))
    ]  # fmt: skip
    unknown = replace(again, problem={**(again.problem or {}), "also": []})
    assert "but are not among the problem's criteria" in verify(rebuilt, unknown)[0]


@pytest.mark.parametrize(
    ("also", "error", "said"),
    [
        (["sicknes"], UnknownName, "Did you mean 'sickness'?"),
        (
            "sickness",
            CriterionError,
            "also must be a list of criteria such as ['sickness', 'rotation'], got 'sickness'",
        ),
        ({"sickness": {}}, CriterionError, "also must be a list of criteria"),
        (["personal_space"], CriterionError, "requires people, which neither the model nor the world has"),
        (["look_at"], CriterionError, "target"),
        (
            [{"obstruction": {"radius": 1.0}}],
            CriterionError,
            "'obstruction' already has a column with other parameters",
        ),
        ([{"exposure": {"radius": 1.0}}], CriterionError, "'exposure' already has a column with other parameters"),
        (["clearance", {"clearance": {"enough": 3.0}}], CriterionError, "'clearance' already has a column"),
    ],
)
def test_what_cannot_be_evaluated_is_refused(
    problem: hpop.Problem, front: hpop.Front, also: list[str], error: type[Exception], said: str
) -> None:
    with pytest.raises(error, match=re.escape(said)):
        problem.evaluate(front, also=also)


def test_a_front_of_another_problem_is_refused(problem: hpop.Problem, front: hpop.Front) -> None:
    elsewhere = replace(problem, start=(1.0, 2.0, 0.0), goal=(4.0, 3.0, 0.0))
    assert len(elsewhere.evaluate(front, also=["jerk"])) == len(front)  # costs are the trajectory's alone
    for other, said in (
        (replace(problem, world=WORLD.with_content(landmarks=[Landmark(1, 3, z=1.0)])), "world differ"),
        (replace(problem, model=hpop.DifferentialDrive(radius=0.2, speed=2.0)), "model differ"),
        (replace(problem, criteria=("turns", "length")), "criteria differ"),
    ):
        with pytest.raises(QueryError, match=f"one of this problem, but {said}; evaluate it by its own"):
            other.evaluate(front, also=["jerk"])
    with pytest.raises(QueryError, match="expected a trajectory, such as"):
        problem.evaluate([front])


def test_a_further_criterion_does_not_take_the_place_of_one_that_was_asked_for(
    problem: hpop.Problem, front: hpop.Front
) -> None:
    """Else a file could call an easier obstruction by the name of the one that its problem states."""
    other = replace(problem, criteria=({"obstruction": {"radius": 1.0}}, "turns", "length"))
    lesser = [other.evaluate(trajectory)["obstruction"] for trajectory in front.trajectories]
    forged = replace(
        front,
        reported=np.array(lesser)[:, None],
        problem={**(front.problem or {}), "also": [{"obstruction": {"radius": 1.0}}]},
    )
    assert len(verify(problem, forged)) == len(front)
    assert "obstruction is saved as" in verify(problem, forged)[0]


def test_a_file_whose_further_criteria_make_no_sense_is_refused(problem: hpop.Problem, more: hpop.Front) -> None:
    for wrong in ({"sickness": {}}, "sickness", [5], [{"turns": {"a": 1}}]):
        forged = replace(more, problem={**(more.problem or {}), "also": wrong})
        with pytest.raises(CriterionError):
            verify(problem, forged)
