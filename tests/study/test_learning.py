"""Criteria learnt from ratings: the weights that made the ratings come out, and what is told where there are none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hpop
from hpop.base.arrays import FloatArray
from hpop.criteria import Learnt
from hpop.criteria.base import make_criterion
from hpop.criteria.costs import trajectory_costs
from hpop.errors import CriterionError, HpopWarning, StudyError
from hpop.study import fit_criterion
from tests.view.explorer.fronts import seeded

PROBLEM, FRONT = seeded(40)
NAMES = ("rotation", "length", "exposure")
TRUE = np.array([0.3, 0.0, 0.8])


def costs() -> FloatArray:
    return trajectory_costs([make_criterion(name) for name in NAMES], FRONT.trajectories, PROBLEM.world)


def rated(noise: float, people: int = 8, each: int = 15, seed: int = 0) -> tuple[list[float], list[int], list[int]]:
    """Comfort, more is better, of some rows by people who have levels of their own."""
    rng = np.random.default_rng(seed)
    worse = costs() @ TRUE
    rows, who, ratings = [], [], []
    for person in range(people):
        level = rng.normal(100, 20)
        for row in rng.choice(len(FRONT), each, replace=False).tolist():
            rows.append(row)
            who.append(person)
            ratings.append(float(level - worse[row] + noise * rng.normal()))
    return ratings, rows, who


def test_ratings_without_noise_give_their_weights_back() -> None:
    ratings, rows, who = rated(0.0)
    fitted = fit_criterion(ratings, rows, PROBLEM, NAMES, people=who, front=FRONT, source="simulated")
    assert fitted.weights == pytest.approx({"rotation": 0.3, "exposure": 0.8}, rel=1e-9)
    assert fitted.source.error < 1e-9 < fitted.source.error_of_mean
    low = fit_criterion([-r for r in ratings], rows, PROBLEM, NAMES, people=who, front=FRONT, better="low", source="s")
    assert low.weights == pytest.approx(fitted.weights)


def test_lengths_that_differ_by_rounding_alone_take_no_weight() -> None:
    """Straight ways of 4.1 m in all directions, which also differ in exposure; one is shorter, and left out once."""
    model, angles = PROBLEM.model, np.linspace(0, 1.5, 20).tolist()
    ends = [(5 + 4.1 * np.cos(a), 5 + 4.1 * np.sin(a)) for a in angles[1:]]
    ways = [hpop.Trajectory.from_poses(model, [(5, 5, 0), (7, 5, 0)])]
    ways += [hpop.Trajectory.from_poses(model, [(5, 5, a), (*end, a)]) for a, end in zip(angles[1:], ends, strict=True)]
    exposure, lengths = trajectory_costs(list(map(make_criterion, ("exposure", "length"))), ways, PROBLEM.world).T
    assert 0 < np.ptp(lengths[1:]) < 1e-12
    assert np.ptp(exposure) > 0.1
    for seed in range(4):
        ratings = -30 * exposure + np.random.default_rng(seed).normal(size=20)
        given: dict[str, Any] = {"problem": PROBLEM, "criteria": ["length", "exposure"], "source": "simulated"}
        assert "length" not in fit_criterion(ratings[1:], ways[1:], **given).weights
        assert fit_criterion(ratings, ways, **given).source.error < 2.0


def test_noise_is_told_by_the_error_on_trajectories_left_out() -> None:
    ratings, rows, who = rated(2.0)
    ways = [FRONT.trajectories[row] for row in rows]
    fitted = fit_criterion(ratings, ways, PROBLEM, NAMES, people=[f"p{i:02}" for i in who], source="simulated")
    assert fitted.weights["rotation"] == pytest.approx(0.3, rel=0.3)
    assert 1.7 < fitted.source.error < 2.6 < fitted.source.error_of_mean
    assert (fitted.source.ratings, fitted.source.people) == (120, 8)


def test_what_is_learnt_is_a_criterion_of_problems(tmp_path: Path) -> None:
    ratings, rows, who = rated(1.0)
    fitted = fit_criterion(ratings, rows, PROBLEM, NAMES, people=who, front=FRONT, source="simulated")
    learnt = fitted.save(tmp_path / "comfort.json")
    assert {part.name: weight for weight, part in learnt.parts} == fitted.weights
    assert "source: simulated" in str(learnt)
    asked = [{"learnt": {"file": learnt.file}}]
    (again,) = hpop.Problem(PROBLEM.world, PROBLEM.model, (2, 10, 0), (28, 10, 0), asked).criteria
    assert isinstance(again, Learnt)
    assert again == learnt
    worth = trajectory_costs([again], FRONT.trajectories, PROBLEM.world)[:, 0]
    assert np.corrcoef(worth, costs() @ TRUE)[0, 1] > 0.99


def test_ratings_that_have_nothing_to_do_with_costs_are_told() -> None:
    rng = np.random.default_rng(1)
    rows = list(range(40)) * 2
    with pytest.warns(HpopWarning, match="no better than each person's mean"):
        fit_criterion(rng.normal(size=80).tolist(), rows, PROBLEM, NAMES, front=FRONT, source="noise")
    ratings, rows, who = rated(0.0)
    with pytest.raises(StudyError, match="check better='low'"):
        fit_criterion(ratings, rows, PROBLEM, ["rotation"], people=who, front=FRONT, better="low", source="s")


@pytest.mark.parametrize(
    ("change", "kind", "said"),
    [
        ({"source": ""}, StudyError, "source must describe the ratings"),
        ({"people": [1, 2]}, StudyError, "as many trajectories and people"),
        ({"better": "more"}, StudyError, "better must be one of high, low"),
        ({"ratings": [1.0, float("nan")] * 20}, StudyError, "a rating must be a number"),
        ({"front": None}, StudyError, "each rating needs its trajectory; got 0"),
        ({"trajectories": [99] * 40}, StudyError, "its row, 0 to 39; got 99"),
        ({"trajectories": [0, 1] * 20}, StudyError, "at least 5 distinct trajectories, got 2"),
        ({"people": list(range(40))}, StudyError, "rated only one trajectory"),
        ({"criteria": ["obstruction"]}, CriterionError, "use 'exposure'"),
        ({"criteria": ["turns", "turns"]}, CriterionError, "'turns' twice"),
    ],
)
def test_what_does_not_belong_together_is_refused(change: dict[str, object], kind: type[Exception], said: str) -> None:
    given: dict[str, object] = {
        "ratings": np.random.default_rng(0).normal(size=40).tolist(), "trajectories": list(range(40)),
        "problem": PROBLEM, "criteria": NAMES, "front": FRONT, "source": "s",
    }  # fmt: skip
    with pytest.raises(kind, match=said):
        fit_criterion(**(given | change))  # type: ignore[arg-type]


@pytest.mark.parametrize("weight", [1.2e6, 1e-10])
def test_weights_that_no_file_may_hold_are_told_when_they_are_learnt(weight: float) -> None:
    exposure = costs()[:, NAMES.index("exposure")]
    rows = np.flatnonzero(np.abs(exposure - np.median(exposure)) < 0.8)  # ratings stay below a million
    ratings = weight * (np.median(exposure) - exposure[rows])
    with pytest.raises(StudyError, match=f"got {weight:.3g} .* in another unit".replace("+", "[+]")):
        fit_criterion(ratings, rows, PROBLEM, ["exposure"], front=FRONT, source="s")


def test_a_trajectory_is_one_however_often_it_was_read() -> None:
    """Copies of what is learnt from are no trajectories left out: the error would be too small."""
    from copy import deepcopy

    ratings, rows, who = rated(2.0)
    once = fit_criterion(ratings, rows, PROBLEM, NAMES, people=who, front=FRONT, source="simulated")
    copies = [deepcopy(FRONT.trajectories[row]) for row in rows]
    assert fit_criterion(ratings, copies, PROBLEM, NAMES, people=who, source="simulated").source == once.source


def test_people_who_rated_nothing_beside_what_is_left_out_are_told() -> None:
    """One person rated two trajectories, which are left out together, and eleven people one each."""
    together = set(np.flatnonzero(np.random.default_rng(0).permutation(13) % 10 == 0).tolist())
    who = ["p01" if row in together else f"p{row + 2:02}" for row in range(13)]
    better = -(costs()[:13] @ TRUE)
    with pytest.raises(StudyError, match="error on left-out trajectories cannot be computed"):
        fit_criterion(better.tolist(), range(13), PROBLEM, NAMES, people=who, front=FRONT, source="simulated")
