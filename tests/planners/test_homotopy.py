"""Homotopy of two ways: the sides on which obstacles are passed, against winding numbers of their middles."""

import numpy as np
import pytest
import shapely

from hpop.planners.homotopy import between, homotopic
from hpop.world import World

ROOM = shapely.box(0, 0, 10, 10)


def winding(point, one, other):
    """How often the loop along one way and back along the other goes round a point, by summed angles of its edges."""
    loop = [*one, *other[::-1]]
    total = 0.0
    for (ax, ay), (bx, by) in zip(loop, [*loop[1:], loop[0]], strict=True):
        ax, ay, bx, by = ax - point[0], ay - point[1], bx - point[0], by - point[1]
        total += np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
    return round(total / (2 * np.pi))


@pytest.mark.parametrize("seed", range(30))
def test_ways_are_of_one_class_if_no_post_is_wound_about(seed):
    rng = np.random.default_rng(seed)
    posts = rng.uniform(1.5, 8.5, (4, 2))
    world = World.from_polygons([shapely.Point(p).buffer(0.05) for p in posts], extent=ROOM)
    one, other = (np.array([(0.5, 5.0), *rng.uniform(1, 9, (3, 2)), (9.5, 5.0)]) for _ in range(2))
    if shapely.union_all([shapely.LineString(w) for w in (one, other)]).distance(shapely.MultiPoint(posts)) < 0.06:
        return  # a way through a post is no way
    expected = all(winding(post, one, other) == 0 for post in posts)
    assert homotopic(one, other, world.free_space((0.0, 1.0))) == expected


def test_a_way_is_of_its_own_class_and_nothing_lies_between():
    way = np.array([(1.0, 1.0), (5.0, 3.0), (9.0, 1.0)])
    finer = shapely.get_coordinates(shapely.segmentize(shapely.LineString(way), 0.1))
    assert between(way, way).size == 0
    assert homotopic(way, finer, World.from_polygons([], extent=ROOM).free_space((0.0, 1.0)))


def test_a_loop_about_nothing_may_be_pulled_tight_and_one_about_a_post_may_not():
    straight = np.array([(1.0, 5.0), (9.0, 5.0)])
    looped = np.array([(1.0, 5.0), (6.0, 5.0), (6.0, 8.0), (4.0, 8.0), (4.0, 5.0), (9.0, 5.0)])
    for middle, same in (((5.0, 6.5), False), ((5.0, 2.0), True)):
        world = World.from_polygons([shapely.Point(middle).buffer(0.3)], extent=ROOM)
        assert homotopic(straight, looped, world.free_space((0.0, 1.0))) == same
