"""The facets of the hull, against linear programs in fractions: valid, tight, and none missing."""

from __future__ import annotations

from itertools import product
from math import gcd
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.search.supported import WeightCone

Points = list[tuple[int, ...]]
clouds = st.integers(1, 4).flatmap(lambda k: st.lists(st.tuples(*[st.integers(0, 5)] * k), min_size=1, max_size=9))


def cone_of(points: Points) -> WeightCone:
    cone = WeightCone(points[0])
    for point in points[1:]:
        cone.add(point)
    return cone


def dot(w: tuple[int, ...], y: tuple[int, ...]) -> int:
    return sum(a * b for a, b in zip(w, y, strict=True))


@given(clouds)
def test_every_facet_is_valid_and_touches_a_point(points: Points) -> None:
    for w, b in cone_of(points).facets():
        assert min(w) >= 0
        assert max(w) > 0
        assert gcd(*w, b) == 1
        assert min(dot(w, y) for y in points) == b


@given(clouds, st.data())
def test_the_facets_bound_the_hull_and_nothing_more(hull: Any, points: Points, data: st.DataObject) -> None:
    facets = cone_of(points).facets()
    k = len(points[0])
    probes = data.draw(st.lists(st.tuples(*[st.integers(-1, 6)] * k), min_size=1, max_size=6))
    for y in probes:
        assert all(dot(w, y) >= b for w, b in facets) == hull.inside(y, points)


@given(clouds, st.randoms(use_true_random=False))
def test_the_facets_do_not_depend_on_the_order_of_the_points(points: Points, random: Any) -> None:
    shuffled = points.copy()
    random.shuffle(shuffled)
    assert set(cone_of(points).facets()) == set(cone_of(shuffled).facets())


@pytest.mark.parametrize("k", [2, 3, 4, 5])
def test_a_cube_has_the_facets_of_its_least_corner(k: int) -> None:
    corners = list(product((0, 1), repeat=k))
    units = {(tuple(int(i == j) for i in range(k)), 0) for j in range(k)}
    assert set(cone_of(corners).facets()) == units


def test_a_simplex_has_one_more() -> None:
    facets = set(cone_of([(6, 0, 0), (0, 3, 0), (0, 0, 2)]).facets())
    assert facets == {((1, 0, 0), 0), ((0, 1, 0), 0), ((0, 0, 1), 0), ((1, 2, 3), 6)}
