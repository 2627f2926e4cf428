"""Results are evaluated within the time limit: all of them, or a spread over the front with a note on the rest."""

from __future__ import annotations

import numpy as np
import pytest

import hpop
from hpop.criteria.base import make_criterion
from hpop.planners.base import Candidates
from hpop.planners.judgement import FEW, evaluable_in_time
from hpop.runtime.limits import Status

ROBOT = hpop.DifferentialDrive(radius=0.3)
LENGTH, TURNS = make_criterion("length"), make_criterion("turns")


def found(count: int) -> Candidates:
    """Candidates on a curve of trade-offs: the first is the best in length, the last in turns."""
    trajectory = hpop.Trajectory.from_poses(ROBOT, [(0, 0, 0), (1, 0, 0)])
    planned = np.stack([np.arange(count), count - np.arange(count)], axis=1).astype(float)
    return Candidates(
        objectives=(LENGTH, TURNS),
        trajectories=(trajectory,) * count,
        planned=planned,
        tolerance=np.zeros_like(planned),
        status=Status.COMPLETE,
        certificate="all of them",
        provenance=tuple({"number": i} for i in range(count)),
    )


class Work:
    """An evaluation that takes so long a point, on a clock of its own."""

    def __init__(self, limit: float | None, each: float) -> None:
        self.limit, self.each, self.now = limit, each, 0.0

    def left(self) -> float | None:
        return None if self.limit is None else self.limit - self.now

    def evaluate(self, candidates: Candidates) -> None:
        self.now += self.each * len(candidates.trajectories)

    def of(self, candidates: Candidates) -> Candidates:
        return evaluable_in_time(candidates, self.left, self.evaluate, lambda: self.now)


@pytest.mark.parametrize("limit", [None, 100.0])
def test_all_are_evaluated_without_a_limit_and_where_the_time_suffices(limit: float | None) -> None:
    candidates = found(1000)
    assert Work(limit, 0.01).of(candidates) is candidates


@pytest.mark.parametrize("limit", [2.0, 4.0, 9.0])
def test_those_that_are_evaluated_keep_the_limit_and_use_most_of_it(limit: float) -> None:
    work = Work(limit, 0.01)
    some = work.of(found(1000))
    work.evaluate(some)
    assert 0.6 * limit < work.now <= limit


@pytest.mark.parametrize("limit", [-1.0, 0.0, 2.0])
def test_points_that_are_left_out_are_counted_and_the_others_are_spread_over_the_front(limit: float) -> None:
    some = Work(limit, 0.01).of(found(1000))
    numbers = [origin["number"] for origin in some.provenance]
    assert len(numbers) >= FEW - 2
    assert {0, 999} <= set(numbers)
    assert max(np.diff(numbers)) <= 2 * 1000 / len(numbers)
    assert some.status is Status.TIME_LIMIT
    for told in (some.certificate, *some.notes):
        assert f"only {len(numbers)} of the 1,000 points found" in told
    assert "Raise time_limit" in some.notes[-1]


def test_a_few_points_are_always_evaluated() -> None:
    candidates = found(FEW)
    assert Work(-1.0, 0.01).of(candidates) is candidates


def test_an_interruption_while_time_is_measured_loses_no_point() -> None:
    def interrupted(candidates: Candidates) -> None:
        raise KeyboardInterrupt

    kept = evaluable_in_time(found(1000), lambda: 1.0, interrupted)
    assert kept.status is Status.INTERRUPTED
    assert len(kept.trajectories) == 1000
