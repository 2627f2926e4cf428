"""Every query of a drive has options among people who react to the robot; some of them come to touch it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.drive.reacting import Walker, crowd, questions

UP_TO_IT = [Walker("Ann", np.array([3.6, 2.2]), np.zeros(2), 0.35, True, np.zeros(2))]


@pytest.mark.parametrize(
    ("walkers", "most"),
    [
        (UP_TO_IT, 4),
        pytest.param(UP_TO_IT, 7, marks=pytest.mark.proof),
        *(pytest.param(crowd(seed, 4, 2), 60, marks=pytest.mark.proof) for seed in (1, 2, 3)),
    ],
)
def test_each_question_has_options(walkers: list[Walker], most: int) -> None:
    asked = list(questions(walkers, most))
    assert len(asked) >= min(7, most)
    assert [(now, str(options.status)) for now, options in asked if not len(options)] == []
