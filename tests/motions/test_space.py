"""The space of states: angles that come round stay continuous, distances are a metric, a state is checked by name."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import hpop
from hpop.base.math import wrap
from hpop.errors import ModelError, QueryError
from hpop.motions import States, StateSpace

HEAD = StateSpace(  # a base with a head: the pan has end stops, the yaw comes round
    names=("x", "y", "yaw", "pan"),
    units=("m", "m", "rad", "rad"),
    low=(-10.0, 0.0, -math.pi, -2.5),
    high=(10.0, 5.0, math.pi, 2.0),
    weights=(1.0, 1.0, 0.5, 0.25),
    turning=frozenset({"yaw"}),
)
ROWS = 5
states = arrays(np.float64, (4, ROWS), elements=st.floats(-12, 12, width=32)).map(
    lambda columns: States(**dict(zip(HEAD.names, columns, strict=True)))
)


@given(states, states)
def test_what_turns_goes_on_continuously_and_comes_to_the_same(a: States, b: States) -> None:
    onward = HEAD.onward(a, b)
    turned = onward.yaw - a.yaw
    assert (np.abs(turned) <= math.pi + 1e-9).all()
    whole = (onward.yaw - b.yaw) / (2 * math.pi)
    assert np.allclose(whole, np.round(whole), atol=1e-9)
    assert all((getattr(onward, name) == getattr(b, name)).all() for name in ("x", "y", "pan"))
    assert onward.names == HEAD.names


def test_half_a_turn_is_counter_clockwise() -> None:
    a, b = (States(x=np.zeros(1), y=np.zeros(1), yaw=np.array([yaw]), pan=np.zeros(1)) for yaw in (1.0, 1.0 - math.pi))
    assert HEAD.onward(a, b).yaw == pytest.approx(1.0 + math.pi)


@given(states, states, states)
def test_the_distance_is_a_metric(a: States, b: States, c: States) -> None:
    assert (HEAD.apart(a, a) == 0).all()
    assert np.allclose(HEAD.apart(a, b), HEAD.apart(b, a))
    assert (HEAD.apart(a, c) <= HEAD.apart(a, b) + HEAD.apart(b, c) + 1e-9).all()
    turned = States(**{**b.__dict__, "yaw": b.yaw + 2 * math.pi})
    assert np.allclose(HEAD.apart(b, turned), 0.0, atol=1e-9)


def test_distances_between_columns_are_weighted() -> None:
    origin, there = HEAD.state((0, 0, 0, 0)), HEAD.state((3, 4, 0, 0))
    assert HEAD.apart(origin, there) == pytest.approx(5.0)
    assert HEAD.apart(origin, HEAD.state((0, 0, math.pi, 2))) == pytest.approx(math.hypot(math.pi / 2, 0.5))


def test_a_radian_of_the_drive_counts_what_it_moves_in_that_time() -> None:
    space = hpop.DifferentialDrive(speed=1.2, turn_rate=2.0).space
    assert space.apart(space.state((0, 0, 0)), space.state((0, 0, 1))) == pytest.approx(0.6)


@given(st.integers(0, 2**32), st.integers(0, 50))
def test_samples_are_within_bounds(seed: int, n: int) -> None:
    drawn = HEAD.bounded(x=(2.0, 3.0)).sample(np.random.default_rng(seed), n)
    assert drawn.size == n
    assert ((drawn.x >= 2.0) & (drawn.x <= 3.0)).all()
    for name, low, high in list(zip(HEAD.names, HEAD.low, HEAD.high, strict=True))[1:]:
        assert ((getattr(drawn, name) >= low) & (getattr(drawn, name) <= high)).all()


@given(st.tuples(st.floats(-10, 10), st.floats(0, 5), st.none() | st.floats(-9, 9), st.none() | st.floats(-2.5, 2)))
def test_a_state_in_order_or_by_name_is_the_same(row: tuple[float | None, ...]) -> None:
    by_name = dict(reversed(list(zip(HEAD.names, row, strict=True))))
    stored = States(**{name: np.array([np.nan if value is None else value]) for name, value in by_name.items()})
    for given_ in (row, list(row), by_name, stored):
        if given_ is stored and abs(row[2] or 0) > math.pi:  # a trajectory's yaw counts whole turns
            row = (*row[:2], float(wrap(row[2])), row[3])
        assert HEAD.values(HEAD.state(given_, free=HEAD.angles)) == row


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ((1, 2), "the goal must be given as (x m, y m, yaw rad, pan rad), got (1, 2)"),
        ((1, 2), "got (1, 2); write None for an angle that is free"),
        (None, "the goal must be given as (x m, y m, yaw rad, pan rad), got None"),
        (States(x=np.zeros(2), y=np.zeros(2)), "the goal must be one state, got 2 states; take one: states.take([0])"),
        (States(x=np.zeros(1), y=np.zeros(1)), "it lacks yaw, pan"),
        ({"x": 1, "y": 2, "yaw": 0}, "yaw': 0}: it lacks pan"),
        ({"x": 1, "y": 2, "yaw": 0, "pam": 0}, "it lacks pan and names 'pam', which is no state of the model. Did you "
         "mean 'pan'?"),
        ((1, 2, 0, 2.1), "the pan of the goal must be an angle in rad from -2.5 to 2, got 2.1"),
        ((1, 2, 0, 90), "the pan of the goal must be in radians, within two turns of 0, got 90; for degrees"),
        ((1, 6, 0, 0), "y of the goal must be a position in m from 0 to 5, got 6"),
        ((1, None, 0, 0), "y of the goal must be a position in m from 0 to 5, got None"),
        ((1, 2, None, 0), "the goal needs a yaw in rad; only the goal's may be free"),
        ((1, 2, True, 0), "the yaw of the goal must be an angle in rad"),
        ((1, 2, np.nan, 0), "the yaw of the goal must be an angle in rad"),
    ],
)  # fmt: skip
def test_a_state_that_the_model_does_not_have_is_refused(values: object, said: str) -> None:
    with pytest.raises(QueryError) as error:
        HEAD.state(values, what="goal")  # type: ignore[arg-type]
    assert said in str(error.value)


@pytest.mark.parametrize(
    "changes",
    [{"units": ("m",)}, {"names": ("x", "x", "yaw", "pan")}, {"turning": {"x"}}, {"turning": {"z"}},
     {"low": (0, 6, 0, 0)}],
)  # fmt: skip
def test_a_space_that_contradicts_itself_is_refused(changes: dict[str, object]) -> None:
    with pytest.raises(ModelError):
        StateSpace(**{**HEAD.__dict__, **changes})  # type: ignore[arg-type]


def test_states_are_told_in_one_short_line() -> None:
    assert repr(HEAD.sample(np.random.default_rng(0), 2000)) == "<States: 2,000 of x, y, yaw, pan>"


def test_turns_lead_from_each_state_to_the_next_by_at_most_half_a_turn() -> None:
    yaw = np.array([0.1, 6.2, 3.0, -3.0, -3.0 + np.pi])
    turns = HEAD.turns(States(x=np.zeros(5), y=np.zeros(5), yaw=yaw, pan=np.zeros(5)))
    assert list(turns) == ["yaw"]
    assert np.abs(turns["yaw"]).max() <= np.pi
    whole = (yaw[:-1] + turns["yaw"] - yaw[1:]) / (2 * np.pi)
    np.testing.assert_allclose(whole, np.round(whole), atol=1e-12)
