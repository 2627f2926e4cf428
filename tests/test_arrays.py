"""Small functions of arrays."""

import numpy as np
import pytest

from hpop.base.arrays import distinct


def test_distinct_values_are_those_of_numpy_and_ask_nothing_of_its_masked_arrays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(0)
    whole = rng.integers(-3, 9, (4, 7))
    samples = [whole, whole[:, ::2] / 7, np.zeros(0), np.array([np.nan, 1.0, np.nan, -0.0, 0.0])]
    expected = [np.unique(values) for values in samples]
    monkeypatch.delattr(np.ma, "is_masked")
    for values, known in zip(samples, expected, strict=True):
        np.testing.assert_array_equal(distinct(values), known)
