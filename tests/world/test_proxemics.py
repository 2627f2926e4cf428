"""How places lie to people, and effects of many people on many places."""

import math

import numpy as np
import pytest

from hpop.motions.symbolic import lift
from hpop.world.content.content import Person
from hpop.world.content.proxemics import BLOCK, in_frame, offset, over, position


def test_who_walks_faces_where_they_go_and_who_stands_where_the_body_does():
    for person, heading in ((Person(0, 0, 1.0, velocity=(0.0, -2.0)), -math.pi / 2), (Person(0, 0, 1.0), 1.0)):
        t = np.zeros(1) if person.moves else None
        assert in_frame(person, math.cos(heading), math.sin(heading), t) == (pytest.approx(1.0), pytest.approx(0.0))


def test_who_stands_is_there_without_a_time():
    assert position(Person(1, 2), None) == (1, 2)


def test_the_frame_of_a_person_against_complex_numbers():
    person, t = Person(1.0, -2.0, 0.4, velocity=(0.3, 0.8)), np.array([0.0, 2.0])
    x, y = np.array([3.0, -1.0]), np.array([0.5, 0.7])
    way = x + 1j * y - (complex(1, -2) + complex(0.3, 0.8) * t)
    dx, dy = offset(person, x, y, t)
    assert dx + 1j * dy == pytest.approx(way)
    ahead, left = in_frame(person, x, y, t)
    assert ahead + 1j * left == pytest.approx(way / complex(0.3, 0.8) * abs(complex(0.3, 0.8)))


@pytest.mark.parametrize("size", [0, 1, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 5])
@pytest.mark.parametrize("distinct", [1, 7, 10**9])
@pytest.mark.parametrize("combine", [np.add, np.maximum])
def test_blocks_and_runs_of_equal_samples_change_nothing(size, distinct, combine):
    rng = np.random.default_rng(size)
    x, y = np.sort(rng.integers(0, distinct, size)) / 7.0, np.sort(rng.integers(0, min(distinct, 3), size)) * 1.0

    def effect(item, x, y, t):
        assert t is None
        return np.sin(item * x) + y

    found = over([1.0, 2.0, 3.0], effect, combine, x, y, None)
    assert found.shape == (size,)
    np.testing.assert_allclose(found, combine.reduce([np.sin(item * x) + y for item in (1.0, 2.0, 3.0)]), 1e-6, 1e-12)


def test_runs_of_equal_samples_are_asked_once():
    asked = []

    def effect(item, x):
        asked.append(x.size)
        return item * x

    assert (
        over([2.0], effect, np.add, np.repeat(np.arange(10.0), 56)).tolist()
        == np.repeat(np.arange(0.0, 20.0, 2.0), 56).tolist()
    )
    assert asked == [10]


def test_symbols_pass_through_whole():
    casadi = pytest.importorskip("casadi")
    vector = casadi.MX.sym("x", 3)
    column = over([1.0, 2.0], lambda item, x, t: item * x * x, np.add, lift(vector, 3), None)
    values = casadi.Function("f", [vector], [casadi.MX(column)])([1.0, 2.0, 3.0])
    assert np.array(values).ravel().tolist() == [3.0, 12.0, 27.0]
