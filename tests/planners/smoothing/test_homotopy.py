"""Homotopy of two ways: against winding numbers, and where these do not tell."""

import numpy as np
import pytest
import shapely

from hpop.planners.programs.polyline import crossing_word, holes, homotopic
from hpop.world import World

ROOM = shapely.box(0, 0, 10, 10)


def winding(point, one, other):
    """Return the winding number of the loop along one path and back along another, by summed angles of its edges."""
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
    assert crossing_word(np.concatenate([way, way[::-1]]), np.array([(5.0, 2.0), (4.0, 1.5)])) == []
    assert homotopic(way, finer, World.from_polygons([], extent=ROOM).free_space((0.0, 1.0)))


def test_a_loop_about_nothing_may_be_pulled_tight_and_one_about_a_post_may_not():
    straight = np.array([(1.0, 5.0), (9.0, 5.0)])
    looped = np.array([(1.0, 5.0), (6.0, 5.0), (6.0, 8.0), (4.0, 8.0), (4.0, 5.0), (9.0, 5.0)])
    for middle, same in (((5.0, 6.5), False), ((5.0, 2.0), True)):
        world = World.from_polygons([shapely.Point(middle).buffer(0.3)], extent=ROOM)
        assert homotopic(straight, looped, world.free_space((0.0, 1.0))) == same


def ring(x, y, radius):
    """Once round (x, y), from below and back there, counter-clockwise."""
    angles = np.linspace(-np.pi / 2, 1.5 * np.pi, 17)
    return np.stack([x + radius * np.cos(angles), y + radius * np.sin(angles)], axis=1)


TWO = World.from_polygons([shapely.Point(x, 6.0).buffer(0.1) for x in (4.0, 6.0)], extent=ROOM).free_space((0.0, 1.0))


def test_the_order_in_which_two_posts_are_gone_round_matters_though_neither_is_wound_about():
    begin, end = [(5.0, 1.0)], [(5.0, 2.0)]
    first, second = ring(4.0, 6.0, 0.8), ring(6.0, 6.0, 0.8)
    one, other = np.concatenate([begin, first, second, end]), np.concatenate([begin, second, first, end])
    assert all(winding(post, one, other) == 0 for post in ((4.0, 6.0), (6.0, 6.0)))
    assert not homotopic(one, other, TWO)
    assert homotopic(one, np.concatenate([begin, ring(4.0, 6.0, 0.6), ring(6.0, 6.0, 0.7), end]), TWO)


@pytest.mark.parametrize("seed", range(20))
def test_going_anywhere_and_back_the_same_way_changes_no_class(seed):
    rng = np.random.default_rng(seed)
    way = np.array([(0.5, 5.0), *rng.uniform(1, 9, (4, 2)), (9.5, 5.0)])
    there = np.concatenate([way[2:3], rng.uniform(1, 9, (6, 2))])
    strayed = np.concatenate([way[:2], there, there[::-1], way[3:]])
    loop = np.concatenate([way, strayed[::-1]])
    posts = rng.uniform(1.5, 8.5, (12, 2))
    posts[6:, 0] = posts[:6, 0]  # in pairs in one line
    assert crossing_word(loop, posts) == []
    assert crossing_word(way, posts) == crossing_word(strayed, posts)


def test_posts_in_one_line_are_told_apart_whichever_way_they_are_crossed():
    posts = np.array([(5.0, 4.0), (5.0, 6.0)])
    both = np.array([(4.0, 7.0), (6.0, 7.0)])
    assert crossing_word(both, posts) == [1, 2]
    assert crossing_word(both[::-1], posts) == [-2, -1]


def test_only_holes_that_the_loop_may_go_about_are_looked_at():
    assert holes(ring(4.0, 6.0, 0.5), TWO).round(1).tolist() == [[4.0, 6.0]]
    assert holes(ring(2.0, 2.0, 0.5), TWO).shape == (0, 2)
