"""The scene of a ride: each obstacle with its heights and number, people and landmarks at their positions."""

import json
import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis.extra.numpy import array_shapes, arrays

import hpop
from hpop.view.ride import surfaces
from hpop.view.ride.columns import boxes
from hpop.view.ride.scene import ViewScene
from hpop.world import Box, Solid, pose_at
from hpop.world.content.content import Landmark, Person, Zone

ROUND = shapely.Point(6, 3).buffer(1.0, 4).difference(shapely.box(5.8, 2.8, 6.2, 3.2))


def problem_of(world: hpop.World, height: float = 1.2) -> hpop.Problem:
    return hpop.Problem(world, hpop.DifferentialDrive(camera_height=height), (1, 1, 0), (2, 1, 0), ["length"])


@pytest.fixture(scope="module")
def scene() -> ViewScene:
    world = hpop.World.from_polygons(
        [shapely.box(4, 0, 4.2, 5), (ROUND, (0.0, 0.8))], extent=shapely.box(0, 0, 9, 6)
    ).with_content(
        people=[Person(2, 3, 0.5, (0.5, 0), name="</script><b>"), Person(2, 4, radius=0.4)],
        landmarks=[Landmark(3, 5, facing=-math.pi / 2, name="owl"), Landmark(6.5, 3, z=0.5)],
        zones=[Zone("speed", shapely.box(0, 0, 2, 2), limit=0.3)],
    )
    return ViewScene.of(problem_of(world))


@given(arrays(bool, array_shapes(min_dims=2, max_dims=2, max_side=12)))
def test_boxes_cover_each_occupied_cell_once_and_no_other(cells):
    covered = np.zeros(cells.shape, int)
    for x0, y0, x1, y1 in boxes(cells):
        assert x0 < x1
        assert y0 < y1
        covered[y0:y1, x0:x1] += 1
    np.testing.assert_array_equal(covered, cells)


def test_rings_run_round_what_is_solid_on_their_left(scene):
    for prism in scene.prisms:
        outer, *holes = (shapely.LinearRing(ring) for ring in prism.rings)
        assert outer.is_ccw
        assert not any(hole.is_ccw for hole in holes)
    assert [len(prism.rings) for prism in scene.prisms] == [1, 2]
    assert shapely.Polygon(scene.prisms[1].rings[0], scene.prisms[1].rings[1:]).equals(ROUND)


def test_what_has_no_end_is_a_storey_high_and_that_is_said(scene):
    assert [(prism.low, prism.high) for prism in scene.prisms] == [(0.0, 3.0), (0.0, 0.8)]
    assert any("3 m high" in note for note in scene.notes)
    assert ViewScene.of(problem_of(hpop.World.from_polygons([shapely.box(4, 0, 5, 1)]), 3.2)).storey == 4.0


def test_each_thing_has_a_number_of_its_own(scene):
    numbers = [item.number for items in (scene.prisms, scene.figures, scene.plates) for item in items]
    assert numbers == list(range(1, 7))


def test_the_description_is_strict_json_with_names_as_they_are(scene):
    text = json.dumps(scene.description(), allow_nan=False)
    found = json.loads(text)
    assert [person["name"] for person in found["people"]] == ["</script><b>", ""]
    (begun, x, y, yaw), (ended, *place) = found["people"][0]["way"]
    assert (begun, ended) == (0.0, scene.figures[0].person.until)  # it stops at a wall, and stays
    assert found["people"][0]["there"] == [0.0, None]
    assert place[:2] == pytest.approx([x + 0.5 * ended, y], abs=1e-4)
    assert yaw == round(scene.figures[0].person.yaw, 4)
    assert [mark["facing"] for mark in found["landmarks"]] == [-math.pi / 2, None]
    assert found["zones"][0]["kind"] == "speed"


def test_a_person_s_trunk_is_as_wide_as_the_person(scene):
    for figure in scene.figures:
        assert max(part.radius for part in figure.parts) == figure.person.radius
        assert 1.5 < max(part.high for part in figure.parts) < 2.0


def test_a_landmark_that_an_obstacle_hides_is_told(scene):
    assert sum("inside an obstacle" in note for note in scene.notes) == 1


def test_cells_lie_where_the_raster_has_them():
    occupied = np.zeros((6, 8), bool)
    occupied[2:4, 1:5] = occupied[5, 7] = True
    world = hpop.World.from_cells(occupied, 0.5, origin=(1.0, -2.0, 0.3))
    scene = ViewScene.of(problem_of(world))
    drawn = shapely.union_all([shapely.Polygon(box) for box in scene.cells.corners])
    assert drawn.symmetric_difference(world.ground.raster_solid()).area < 1e-12
    assert all(shapely.LinearRing(box).is_ccw for box in scene.cells.corners)
    border = shapely.union_all([shapely.Polygon(p.rings[0], p.rings[1:]) for p in scene.prisms])
    assert border.intersection(world.extent).area < 1e-9  # the camera counts all beyond the map as obstacle
    assert border.touches(world.extent)
    assert scene.cells.number == len(scene.prisms) + 1


def test_a_solid_that_leans_is_described_as_it_is_and_said_to_be_drawn_as_a_prism():
    leans = Solid(Box((1.0, 0.2, 2.0)), pose_at((4, 4, 1), rpy=(0.3, 0, 0)), "ladder")
    stands = Solid(Box((1.0, 1.0, 1.0)), pose_at((6, 4, 0.5)), "crate")
    scene = ViewScene.of(problem_of(hpop.World.from_solids([leans, stands])))
    assert [prism.solid is None for prism in scene.prisms] == [False, True]
    assert scene.prisms[0].description()["solid"]["name"] == "ladder"
    assert any("ladder" in note and "crate" not in note for note in scene.notes)


def test_the_texture_repeats_has_mean_square_1_and_no_detail_finer_than_its_shortest_wave():
    i, j, amplitude, phase = surfaces.waves().T
    assert (i == i.round()).all()
    assert (j == j.round()).all()
    u = np.arange(256) * surfaces.PERIOD / 256
    U, V = np.meshgrid(u, u)
    turns = (i * U[..., None] + j * V[..., None]) / surfaces.PERIOD
    texture = np.sum(amplitude * np.cos(2 * np.pi * turns + phase), axis=2)
    assert np.mean(texture**2) == pytest.approx(1.0, abs=1e-9)
    assert abs(texture.mean()) < 1e-9
    assert np.abs(texture).max() < 5.0
    assert len(set(zip(i, j, strict=True)) | set(zip(-i, -j, strict=True))) == 2 * len(i)  # no wave twice
    assert surfaces.PERIOD / np.hypot(i, j).max() > 0.9 * surfaces.SHORTEST
