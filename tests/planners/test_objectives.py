"""Edge costs as whole numbers of quanta: near the float, no shortcut lost."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria import Length, Turns
from hpop.planners.objectives import quantised

AMOUNTS = st.floats(0.0, 1e6, allow_nan=False)  # in quanta


@given(one=AMOUNTS, other=AMOUNTS, less=st.floats(0.0, 1.0))
def test_what_costs_no_more_than_two_together_still_does(one, other, less):
    """Dominance among the turns at a place rests on it; to the nearest, 0.4 and 0.4 would be 0 and their sum 1."""
    both = np.array([one, other, less * (one + other)]) * Length().quantum
    first, second, instead = quantised(both, Length()).tolist()
    assert instead <= first + second


@given(amount=AMOUNTS)
def test_costs_are_rounded_up_by_less_than_a_quantum(amount):
    (rounded,) = quantised(np.array([amount * Length().quantum]), Length())
    assert -2e-6 <= rounded - amount < 1.0


def test_whole_numbers_stay_whatever_their_last_digit():
    q = Length().quantum
    assert quantised(
        np.array([3000 * (0.1 + 0.2) * q, 900 * q, np.nextafter(900 * q, 1.0), 0.0]), Length()
    ).tolist() == [
        900,
        900,
        900,
        0,
    ]
    assert quantised(np.array([0.0, 1.0, 2.0]), Turns()).tolist() == [0, 1, 2]
