"""Unseen landmarks: in a hall with a wall, where it is plain what was seen and when."""

import numpy as np
import pytest
import shapely

from hpop.criteria import UnseenLandmarks, trajectory_cost
from hpop.criteria.costs import running_costs
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.content import Landmark

MODEL = DifferentialDrive()
WALL = shapely.box(0, 5, 10, 5.2)  # open from x = 10 to x = 16
NORTH, SOUTH = Landmark(2, 9, weight=3.0), Landmark(2, 1)


def hall(*landmarks, obstacles=(WALL,)):
    return World.from_polygons(obstacles, extent=shapely.box(0, 0, 16, 10)).with_content(landmarks=landmarks)


def drive(*places):
    return Trajectory.from_poses(MODEL, [(x, y, 0) for x, y in places])


def test_what_stays_behind_the_wall_is_missed_by_its_weight():
    world = hall(NORTH, SOUTH)
    assert trajectory_cost(UnseenLandmarks(far=30), drive((1, 3), (6, 3)), world) == 0.75
    assert trajectory_cost(UnseenLandmarks(far=30), drive((1, 7), (6, 7)), world) == 0.25
    assert trajectory_cost(UnseenLandmarks(far=30), drive((1, 3), (14, 3), (14, 9)), world) == 0.0


def test_the_running_value_falls_when_a_landmark_comes_into_sight():
    world = hall(NORTH, SOUTH)
    route = Trajectory.from_poses(MODEL, [(1, 3, 0), (6, 3, 0), (14, 3, np.pi / 2), (14, 9, np.pi / 2), (2, 8, np.pi)])
    values = running_costs(UnseenLandmarks(far=30), route, world)
    # The line from (2, 9) past the wall's end (10, 5.2) to x = 14 is at y = 3.3: out of sight on the way along y = 3.
    assert values.tolist() == [0.75] * 3 + [0.0] * (len(values) - 3)
    assert (np.diff(values) <= 0).all()


def test_a_glance_counts_if_it_lasts_long_enough():
    # A slit 1 m wide, half way between the landmark and the way: 2 m of it see the landmark.
    walls = (shapely.box(0, 5, 7.5, 5.01), shapely.box(8.5, 5, 16, 5.01))
    world = hall(Landmark(8, 9), obstacles=walls)
    past = drive((2, 1), (14, 1))
    lasts = 2.0 / MODEL.speed
    assert trajectory_cost(UnseenLandmarks(least=0.9 * lasts), past, world) == 0.0
    assert trajectory_cost(UnseenLandmarks(least=1.1 * lasts), past, world) == 1.0
    there_and_back = drive((2, 1), (14, 1), (2, 1))
    assert trajectory_cost(UnseenLandmarks(least=1.9 * lasts), there_and_back, world) == 0.0


def test_the_robot_is_judged_by_what_it_does_not_by_the_plan():
    world = hall(Landmark(8, 8), obstacles=())
    route = drive((2, 2), (8, 2))
    executed = route.execution().duration
    assert executed > route.duration
    assert trajectory_cost(UnseenLandmarks(least=executed - 0.1), route, world) == 0.0
    assert trajectory_cost(UnseenLandmarks(least=executed + 0.1), route, world) == 1.0


def test_a_viewer_sees_within_reach_ahead_and_from_the_front():
    route = drive((2, 5), (6, 5))
    ahead, behind = Landmark(9, 5), Landmark(0.5, 5)
    assert trajectory_cost(UnseenLandmarks(fov=2.0), route, hall(ahead, behind, obstacles=())) == 0.5
    assert trajectory_cost(UnseenLandmarks(fov=2 * np.pi), route, hall(ahead, behind, obstacles=())) == 0.0
    assert trajectory_cost(UnseenLandmarks(far=2.9), route, hall(ahead, obstacles=())) == 1.0
    assert trajectory_cost(UnseenLandmarks(far=3.1), route, hall(ahead, obstacles=())) == 0.0
    turned_away, turned_to = (Landmark(9, 5, facing=facing) for facing in (0.0, np.pi))
    assert trajectory_cost(UnseenLandmarks(), route, hall(turned_away, turned_to, obstacles=())) == 0.5


def test_what_the_camera_cannot_see_at_once_is_missed():
    """1.5 m up and 3 m ahead, at closest: 27 degrees, and 90 to the left when it is passed."""
    world = hall(Landmark(9, 5, z=2.7), obstacles=())
    for h, v, missed in ((1.0, 1.0, 0.0), (1.0, 0.4, 1.0), (2 * np.pi, 0.4, 1.0)):
        model = DifferentialDrive(field_of_view=(h, v), camera_height=1.2)
        ahead = Trajectory.from_poses(model, [(5.9, 5, 0), (6, 5, 0)])
        assert trajectory_cost(UnseenLandmarks(), ahead, world) == missed
        aside = Trajectory.from_poses(model, [(9, 2, 0), (9.1, 2, 0)])
        assert trajectory_cost(UnseenLandmarks(), aside, world) == (0.0 if h > np.pi and v > 0.95 else 1.0)
        assert trajectory_cost(UnseenLandmarks(fov=4.0), aside, world) == 0.0


@pytest.mark.parametrize(
    ("bad", "text"),
    [
        ({"least": -1.0}, "least"),
        ({"least": np.inf}, "least"),
        ({"far": 0.0}, "far"),
        ({"far": np.nan}, "far"),
        ({"fov": 0.0}, "fov"),
        ({"fov": 7.0}, "fov"),
    ],
)
def test_bad_parameters_are_named(bad, text):
    with pytest.raises(CriterionError, match=text):
        UnseenLandmarks(**bad)
