"""The picture of a trajectory among people who move: its tubes are where people are, its maps when they are nearest."""

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import QueryError
from hpop.view import draw_encounters, save_pictures
from hpop.world import Person

RADIUS = 0.3


@pytest.fixture(scope="module")
def problem():
    world = hpop.World.from_polygons([shapely.box(4, 0, 4.3, 3)], extent=shapely.box(0, 0, 10, 8))
    ada = Person(9, 4, velocity=(-1.0, 0.0), name="Ada", until=6.0)
    ben = Person(2, 1, velocity=(0.0, 0.5), name="Ben", until=8.0, afterwards="stays")
    world = world.with_content(people=[ada, ben])
    model = hpop.DifferentialDrive(radius=RADIUS)
    return hpop.Problem(world=world, model=model, start=(1, 4, 0), goal=(9, 4, 0), criteria=["length", "hall_zones"])


@pytest.fixture(scope="module")
def trajectory(problem):
    return hpop.Trajectory.from_poses(problem.model, [(1, 4, 0), (3, 4, 0), (9, 4, 0)]).with_hold(at=1, seconds=4.0)


def nearness(problem, x, y, t):
    """Hall's zone of the nearest person by name: brute force from the positions as they were given."""
    ada, ben = (9 - t, 4.0), (2.0, 1 + 0.5 * min(t, 8.0))
    people = [ben, ada] if t < 6.0 else [ben]
    gap = min(np.hypot(x - a, y - b) for a, b in people) - 0.25 - RADIUS
    return gap, int(np.searchsorted([0.0, 0.45, 1.2, 3.6], gap, side="right"))


def test_each_place_of_the_way_is_coloured_by_how_near_somebody_is_then(problem, trajectory):
    figure = draw_encounters(problem, trajectory)
    axes = next(axes for axes in figure.axes if axes.get_ylabel() == "path of the robot (m)")
    (image,) = axes.images
    left, right, bottom, top = image.get_extent()
    gaps = image.get_array()
    assert (left, bottom, top) == (0.0, 0.0, pytest.approx(8.0))
    assert right == pytest.approx(trajectory.duration)
    rng = np.random.default_rng(0)
    seen = set()
    for row, column in zip(rng.integers(gaps.shape[0], size=300), rng.integers(gaps.shape[1], size=300), strict=True):
        s, t = row / (gaps.shape[0] - 1) * top, column / (gaps.shape[1] - 1) * right
        gap, zone = nearness(problem, 1 + s, 4.0, t)
        if abs(t - 6.0) > 0.1:
            assert gaps[row, column] == pytest.approx(gap, abs=1e-6)
            seen.add(zone)
    assert seen == {0, 1, 2, 3, 4}


def test_the_way_is_level_while_the_robot_stands(problem, trajectory):
    figure = draw_encounters(problem, trajectory)
    axes = next(axes for axes in figure.axes if axes.get_ylabel() == "path of the robot (m)")
    (way,) = (line for line in axes.lines if line.get_gid() == "way")
    t, along = way.get_data()
    np.testing.assert_allclose(np.interp([0.0, 2.0, 3.0, 6.0, 8.0], t, along), [0, 2, 2, 2, 4], atol=0.02)
    assert {"Ada", "Ben"} <= {text.get_text() for text in axes.texts}


def test_maps_are_of_the_start_and_of_moments_of_shortest_distance(problem, trajectory):
    figure = draw_encounters(problem, trajectory)
    maps = [axes for axes in figure.axes if axes.get_xlabel() == "x (m)"]
    assert maps[0].get_title() == "0.0 s"
    met = float(maps[-1].get_title().removesuffix(" s")), float(maps[-2].get_title().removesuffix(" s"))
    assert any(abs(t - 5.98) < 0.1 for t in met)  # Ada comes nearest just before she is gone
    people = [patch for patch in maps[-1].patches if patch.get_gid() == "person"]
    assert len(people) == 1 + (met[0] < 6.0)


def test_nobody_who_moves_is_no_such_picture(make_problem, trajectory):
    with pytest.raises(QueryError, match="a world with moving people"):
        draw_encounters(make_problem(), trajectory)


@pytest.mark.proof
def test_pictures_of_a_front_have_it_where_people_move(problem, trajectory, tmp_path):
    front = hpop.Front.of(
        np.array([[8.0, 1.0]]),
        [trajectory],
        names=["length", "hall_zones"],
        units=["m", "s"],
        quanta=[1e-3, 1e-2],
        status="complete",
        certificate="made by hand",
    )
    assert "encounters.png" in {path.name for path in save_pictures(problem, front, tmp_path, dpi=40)}
