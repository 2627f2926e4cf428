"""A map shows all people, conversations, landmarks and zones, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from matplotlib.colors import to_hex

import hpop
from hpop.view import draw_map
from hpop.view.content import MOST_NAMES, draw_content
from hpop.view.ground import KEEP_OUT, View, view_of
from hpop.view.map import path_points
from hpop.view.page import new_figure
from hpop.world import Track
from hpop.world.content.content import Landmark, Person, Zone

WAY = shapely.LineString([(0.5, 5.5), (4, 5.5), (4, 7.5)])
SLOW = Zone("speed", shapely.box(7, 2, 9, 4), limit=0.4)
CLOSED = Zone("keep-out", shapely.box(1, 2.5, 2, 4))
ONE_WAY = Zone("one-way", WAY.buffer(0.4, cap_style="flat"), path=WAY)
STANDING = [Person(3.0, 1.0, 0.5, name="Ada"), Person(3.0, 2.0, -1.0), Person(2.0, 1.5)]
WALKING = Person(8.0, 5.0, 3.0, velocity=(-0.5, 0.25))
STATUE = Landmark(6.0, 3.0, facing=0.0, name="Sue")


@pytest.fixture
def drawn(world):
    """Draw content alone; gives the axes and the words of the legend."""

    def draw(view=None, **content):
        axes = new_figure(5, 4).add_subplot()
        furnished = world.with_content(**content)
        entries = draw_content(axes, furnished, view or View(0, 0, 10, 8))
        return axes, [" ".join(str(entry.get_label()).split()) for entry in entries]

    return draw


def of(axes, gid):
    return axes.findobj(lambda a: a.get_gid() == gid)


def texts(axes):
    return {text.get_text() for text in axes.texts} - {""}


def arrow_of(annotation):
    return np.subtract(annotation.xy, annotation.xyann)


def test_an_empty_world_adds_nothing(drawn):
    axes, entries = drawn()
    assert entries == []
    assert [*axes.patches, *axes.lines, *axes.texts] == []


def test_people_are_discs_of_their_size_with_a_tick_where_they_look(drawn):
    axes, entries = drawn(people=STANDING)
    assert entries == ["person, tick: heading"]
    assert [(disc.center, disc.radius) for disc in of(axes, "person")] == [((p.x, p.y), 0.25) for p in STANDING]
    for person, tick in zip(STANDING, of(axes, "heading"), strict=True):
        dx, dy = np.diff(tick.get_data())
        assert np.arctan2(dy, dx)[0] == pytest.approx(person.yaw)
    assert of(axes, "velocity") == []


def test_people_too_small_to_be_seen_are_enlarged_and_the_legend_says_so(drawn):
    axes, entries = drawn(View(0, 0, 200, 100), people=STANDING[:1])
    assert of(axes, "person")[0].radius > 0.25
    assert entries == ["person (enlarged), tick: heading"]


def test_on_a_small_map_people_are_larger_and_nobody_is_named(world):
    furnished, wide = world.with_content(people=STANDING, landmarks=[STATUE]), View(0, 0, 200, 100)
    radii = []
    for small in (False, True):
        axes = new_figure(5, 4).add_subplot()
        draw_content(axes, furnished, wide, small=small)
        radii.append(of(axes, "person")[0].radius)
        assert ("Sue" in texts(axes)) is not small
    assert radii[1] > radii[0]


def test_who_walks_has_an_arrow_along_the_velocity(drawn):
    axes, entries = drawn(people=[WALKING, Person(1.0, 1.0, velocity=(1.0, 0.5))])
    assert entries == ["person walking, arrow: velocity"]
    slow, fast = (arrow_of(arrow) for arrow in of(axes, "velocity"))
    assert slow[1] / slow[0] == pytest.approx(-0.5)
    assert np.hypot(*fast) / np.hypot(*slow) == pytest.approx(2.0)


def test_two_who_talk_are_joined_and_three_are_in_a_ring(drawn):
    axes, entries = drawn(people=STANDING, groups=[(0, 1)])
    assert of(axes, "conversation")[0].get_xydata().tolist() == [[3, 1], [3, 2]]
    assert entries[0] == "conversation"
    axes, _ = drawn(people=STANDING, groups=[(0, 1, 2)])
    ring = of(axes, "conversation")[0].get_xydata()
    assert len(ring) == 4
    assert ring[0].tolist() == ring[-1].tolist()


def test_four_who_talk_are_joined_round_and_not_across(drawn):
    square = [Person(3, 1), Person(4, 2), Person(4, 1), Person(3, 2)]
    axes, _ = drawn(people=square, groups=[(0, 1, 2, 3)])
    ring = shapely.Polygon(of(axes, "conversation")[0].get_xydata())
    assert ring.is_valid
    assert ring.area == pytest.approx(1.0)


def test_landmarks_are_stars_with_a_tick_where_their_front_looks(drawn):
    axes, entries = drawn(landmarks=[STATUE, Landmark(1.0, 7.0)])
    assert entries == ["landmark, tick: its front"]
    assert len(of(axes, "landmark")) == 2
    (tick,) = of(axes, "facing")
    assert np.diff(tick.get_ydata())[0] == 0.0
    assert np.diff(tick.get_xdata())[0] > 0.0
    _, entries = drawn(landmarks=[Landmark(1.0, 7.0)])
    assert entries == ["landmark"]


def test_names_are_written_where_they_are_few(drawn):
    axes, _ = drawn(people=STANDING, landmarks=[STATUE])
    assert texts(axes) == {"Ada", "Sue"}
    crowd = [Landmark(1.0, 1.0 + i / 10, name=str(i)) for i in range(MOST_NAMES + 1)]
    axes, _ = drawn(landmarks=crowd)
    assert texts(axes) == set()


def test_what_is_out_of_view_is_neither_drawn_nor_in_the_legend(drawn):
    axes, entries = drawn(View(0, 6.5, 1, 8), people=[*STANDING, WALKING], groups=[(0, 1)], landmarks=[STATUE])
    assert entries == []
    assert [*axes.patches, *axes.lines, *axes.texts] == []


def test_a_speed_zone_is_hatched_and_says_its_limit(drawn):
    axes, entries = drawn(zones=[SLOW])
    assert entries == ["speed limit"]
    (patch,) = of(axes, "speed zone")
    assert patch.get_hatch()
    assert patch.get_path().get_extents().bounds == (7, 2, 2, 2)
    assert texts(axes) == {"0.4 m/s"}


def test_a_one_way_zone_has_arrows_along_its_path(drawn):
    axes, entries = drawn(zones=[ONE_WAY])
    assert entries == ["one-way, along the arrows"]
    arrows = of(axes, "way")
    assert len(arrows) > 1
    assert all(WAY.distance(shapely.Point(arrow.xy)) < 1e-9 for arrow in arrows)
    first, last = arrow_of(arrows[0]), arrow_of(arrows[-1])
    assert np.sign(first.round(9)).tolist() == [1, 0]
    assert np.sign(last.round(9)).tolist() == [0, 1]


def test_a_way_shorter_than_an_arrow_still_has_one(drawn):
    short = shapely.LineString([(2, 6), (2, 6.1)])
    axes, _ = drawn(zones=[Zone("one-way", short.buffer(0.4), path=short)])
    assert len(of(axes, "way")) == 1


def test_the_map_shows_the_content_of_its_world(make_problem, make_front, world):
    furnished = world.with_content(
        people=[*STANDING, WALKING], groups=[(0, 1)], landmarks=[STATUE], zones=[SLOW, ONE_WAY, CLOSED]
    )
    problem = make_problem(["turns", "length"], world=furnished)
    figure = draw_map(problem, make_front(problem))
    words = [" ".join(text.get_text().split()) for text in figure.legends[1].get_texts()]
    for entry in (
        "keep-out zone",
        "speed limit",
        "one-way, along the arrows",
        "conversation",
        "landmark, tick: its front",
        "person, tick: heading",
        "person walking, arrow: velocity",
    ):
        assert words.count(entry) == 1
    figure.canvas.draw()


def test_keep_out_zones_look_alike_whether_of_the_map_or_of_the_content(make_problem, make_front):
    open_world = hpop.World.from_polygons([], extent=shapely.box(0, 0, 10, 8))
    problem = make_problem(world=open_world.with_content(zones=[CLOSED]))
    figure = draw_map(problem, make_front(problem))
    axes = next(axes for axes in figure.axes if axes.get_label() == "map")
    patches = [patch for patch in axes.patches if to_hex(patch.get_edgecolor()) == KEEP_OUT]
    assert [patch.get_path().get_extents().bounds for patch in patches] == [(1, 2.5, 1, 1.5)]


def test_the_view_of_a_map_does_not_depend_on_people(make_problem, world):
    bare = make_problem()
    crowded = make_problem(world=world.with_content(people=STANDING, landmarks=[Landmark(99.0, 99.0)]))
    assert view_of(crowded) == view_of(bare)


def limits(figure):
    axes = next(axes for axes in figure.axes if axes.get_label() == "map")
    return np.array([axes.get_xlim(), axes.get_ylim()])


def test_a_map_shows_the_part_where_the_trajectories_lead_if_it_is_small(make_problem, make_front):
    park = hpop.World.from_polygons([shapely.box(45, 45, 47, 47)], extent=shapely.box(-20, -10, 60, 70))
    problem = make_problem(world=park)
    front = make_front(problem)
    paths = np.concatenate([path_points(trajectory) for trajectory in front.trajectories])
    shown = limits(draw_map(problem, front))
    assert (shown[:, 0] < paths.min(axis=0)).all()
    assert (shown[:, 1] > paths.max(axis=0)).all()
    assert np.diff(shown).max() < 30
    nowhere = make_front(problem, costs=np.zeros((0, 2)), status="no path")
    assert np.diff(limits(draw_map(problem, nowhere))).min() > 80


def test_a_map_shows_the_rectangle_that_is_asked_for(make_problem, make_front):
    problem = make_problem()
    assert limits(draw_map(problem, make_front(problem), view=View(2, 1, 6, 4))).tolist() == [[2, 6], [1, 4]]


def test_predicted_ways_that_end_are_dotted_and_who_comes_later_is_dashed(drawn):
    late = Person.along(Track.through([(3.0, 1.0, 1.0), (5.0, 2.0, 4.0)]))
    ending = replace(WALKING, until=2.0)
    axes, entries = drawn(people=[ending, late, Person(3.0, 1.0)])
    ways = {tuple(map(tuple, line.get_xydata()[[0, -1]])) for line in of(axes, "predicted")}
    assert ways == {((8.0, 5.0), (7.0, 5.5)), ((1.0, 1.0), (2.0, 4.0))}
    assert [disc.get_linestyle() for disc in of(axes, "person")] == ["-", "--", "-"]
    assert {"predicted path of a person", "person who comes later, at the first position"} < set(entries)
    assert not of(drawn(people=[WALKING])[0], "predicted")  # for ever
