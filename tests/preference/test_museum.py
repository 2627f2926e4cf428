"""Simulated people on the museum's front: how far from their best row they end, question by question."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hpop.base.arrays import FloatArray
from hpop.preference import Preference, Prior
from hpop.scenario import load_scenario
from tests import preferring as people

PEOPLE = 50


@pytest.mark.proof
def test_telling_questions_leave_little_regret_on_the_museum_and_less_than_random_ones() -> None:
    scenario = load_scenario(Path(__file__).parents[2] / "examples" / "museum.yaml")
    front = scenario.problem.solve(list(scenario.planners))
    assert front.costs.shape == (158, 3)
    regrets: dict[bool, list[list[float]]] = {True: [], False: []}
    for i in range(PEOPLE):
        shares, sharpness, _ = people.drawn(Prior(random=0.0), 3, i)
        for telling, found in regrets.items():
            person, rng = Preference.fit(front, seed=i), np.random.default_rng([i, 4])
            costs: FloatArray = person.scale.rows_on(front) @ shares
            found.append([])
            for questions in (12, 13):
                person = people.asked(person, questions, sharpness * shares, rng, telling=telling)
                found[-1].append(float((costs[person.row(front)] - costs.min()) / np.ptp(costs)))
    after = {telling: np.mean(found, axis=0) for telling, found in regrets.items()}
    print(after)
    assert after[True][0] <= 0.025
    assert after[True][1] <= 0.01
    assert (after[True] < after[False]).all()
