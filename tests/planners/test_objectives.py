"""Edge costs as whole numbers of quanta: near the float, no shortcut lost."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import hpop
from hpop.criteria import Length, Turns
from hpop.motions import Motions, States
from hpop.planners.objectives import quantised, rounding_noise

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


@pytest.mark.parametrize("whole", [0, 3])
def test_no_turn_costs_more_than_two_whose_costs_are_near_the_rounding_noise(whole):
    """Costs in proportion to the duration, from 0 to 4e-6 quanta a second beside whole numbers of quanta a second."""
    yaw = np.arange(8) * np.pi / 4
    a, b = (axis.ravel() for axis in np.meshgrid(yaw, yaw, indexing="ij"))
    model = hpop.DifferentialDrive(radius=0.3)
    turn = (b - a + np.pi) % (2 * np.pi) - np.pi
    at = np.zeros_like(a)
    motions = Motions(None, model, model.laws["turn"], States(x=at, y=at, yaw=a), States(x=at, y=at, yaw=a + turn))
    for rate in whole + np.linspace(0.0, 4e-6, 81):
        costs = rate * motions.duration * Length().quantum
        table = quantised(costs, Length(), rounding_noise(motions)).reshape(8, 8)
        assert (table[:, None, :] <= table[:, :, None] + table[None, :, :]).all()
        assert (np.abs(table - rate * motions.duration.reshape(8, 8)) < 1 + 1e-5).all()
