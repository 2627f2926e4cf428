"""Landmarks in view and landmarks never seen."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.integrate import quad

from hpop.criteria import LandmarkBlindness, LandmarkVisibility, UnseenLandmarks, trajectory_cost
from hpop.criteria.costs import running_costs
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.content import Landmark

MODEL = DifferentialDrive()
EYE = MODEL.camera_height


def hall_of_landmark_visibility(*landmarks, obstacles=()):
    return World.from_polygons(obstacles, extent=shapely.box(0, 0, 16, 10)).with_content(landmarks=landmarks)


def test_driving_away_costs_what_the_distance_fades():
    world = hall_of_landmark_visibility(Landmark(1, 5, z=EYE))
    away = Trajectory.from_poses(MODEL, [(2, 5, 0), (15, 5, 0)])
    seen, _ = quad(lambda d: np.clip((9 - d) / (9 - 4), 0, 1), 1, 14, points=[4, 9])
    cost = trajectory_cost(LandmarkVisibility(near=4.0, far=9.0), away, world)
    assert cost == pytest.approx(1 - seen / 13, abs=1e-3)


def test_distances_are_measured_in_three_dimensions():
    world = hall_of_landmark_visibility(Landmark(8, 5, z=EYE + 4))
    here = Trajectory.from_poses(MODEL, [(8, 2, 0), (8, 2, 2)])
    assert trajectory_cost(LandmarkVisibility(near=0.0, far=10.0), here, world) == pytest.approx(0.5, abs=1e-3)


def test_passing_a_picture_costs_the_cosine_of_the_angle_to_its_front():
    # On a line 2 m in front of a picture at x = 8: cos = 2 / sqrt(4 + (x - 8)²).
    world = hall_of_landmark_visibility(Landmark(8, 2, z=EYE, facing=np.pi / 2))
    past = Trajectory.from_poses(MODEL, [(3, 4, 0), (13, 4, 0)])
    seen, _ = quad(lambda x: 2 / np.hypot(2, x - 8), 3, 13)
    assert trajectory_cost(LandmarkVisibility(near=20, far=30), past, world) == pytest.approx(1 - seen / 10, abs=1e-3)
    behind = Trajectory.from_poses(MODEL, [(3, 1, 0), (13, 1, 0)])
    assert trajectory_cost(LandmarkVisibility(), behind, world) == pytest.approx(1.0, abs=1e-12)


def test_behind_a_wall_the_landmark_is_missed_for_as_long_as_its_shadow_is_wide():
    # Landmark at (8, 1), wall of half-width 1 at y = 3: at y = 5 its shadow goes from x = 6 to x = 10.
    world = hall_of_landmark_visibility(Landmark(8, 1, z=EYE), obstacles=[shapely.box(7, 3, 9, 3.001)])
    past = Trajectory.from_poses(MODEL, [(3, 5, 0), (13, 5, 0)])
    criterion = LandmarkVisibility(near=20, far=30)
    assert trajectory_cost(criterion, past, world) == pytest.approx(0.4, abs=2e-3)
    assert trajectory_cost(criterion.integral, past, world) == pytest.approx(4 / MODEL.speed, abs=2e-2)


def test_weights_say_how_much_each_landmark_counts():
    # The wall hides the landmark in the south, of weight 1, never that in the north, of weight 3.
    wall = shapely.box(0, 4, 16, 4.1)
    world = hall_of_landmark_visibility(Landmark(8, 1, z=EYE), Landmark(8, 9, z=EYE, weight=3.0), obstacles=[wall])
    past = Trajectory.from_poses(MODEL, [(3, 6, 0), (13, 6, 0)])
    assert trajectory_cost(LandmarkVisibility(near=20, far=30), past, world) == pytest.approx(0.25)


@pytest.mark.parametrize("fov", [1.0, 2.0, 4.0])
def test_a_viewer_looks_ahead_within_the_angle_of_view(fov):
    world = hall_of_landmark_visibility(
        Landmark(8, 8, z=EYE), Landmark(4, 3, z=EYE, weight=2.0), Landmark(10, 4, z=EYE)
    )
    turns = Trajectory.from_poses(MODEL, [(8, 4, -3), (8, 4, -0.4), (8, 4, 2.4), (5, 6, 2.4)])
    t = np.linspace(0, turns.duration, 200_001)
    s = turns.at((t[1:] + t[:-1]) / 2)
    seen = np.zeros(t.size - 1)
    for mark in world.content.landmarks:
        off = np.angle(np.exp(1j * (np.arctan2(mark.y - s.y, mark.x - s.x) - s.yaw)))
        seen += mark.weight / 4 * (np.abs(off) <= fov / 2)
    cost = trajectory_cost(LandmarkVisibility(near=20, far=30, fov=fov), turns, world)
    assert cost == pytest.approx(1 - seen.mean(), abs=0.015)  # the nodes of a panel are up to 5 degrees apart


def test_without_an_angle_of_its_own_the_viewer_has_the_cameras():
    """Bearings and elevations: a landmark counts while both are within half the angles that the model sees at once."""
    marks = Landmark(8, 8, z=EYE), Landmark(4, 3, z=EYE + 1.5, weight=2.0), Landmark(10, 4, z=EYE - 1.0)
    world, h, v = hall_of_landmark_visibility(*marks), 2.0, 0.8
    narrow = DifferentialDrive(field_of_view=(h, v))
    poses = [(8, 4, -3), (8, 4, -0.4), (8, 4, 2.4), (5, 6, 2.4)]
    turns = Trajectory.from_poses(narrow, poses)
    t = np.linspace(0, turns.duration, 100_001)
    s = turns.at((t[1:] + t[:-1]) / 2)
    seen = np.zeros(t.size - 1)
    for mark in marks:
        dx, dy = mark.x - s.x, mark.y - s.y
        off = np.angle(np.exp(1j * (np.arctan2(dy, dx) - s.yaw)))
        above = np.arctan((mark.z - EYE) / np.hypot(dx, dy))
        seen += mark.weight / 4 * (np.abs(off) <= h / 2) * (np.abs(above) <= v / 2)
    by_model = trajectory_cost(LandmarkVisibility(near=20, far=30), turns, world)
    assert by_model == pytest.approx(1 - seen.mean(), abs=0.015)
    asked = LandmarkVisibility(near=20, far=30, fov=h)
    everywhere = Trajectory.from_poses(MODEL, poses)
    assert trajectory_cost(asked, turns, world) == trajectory_cost(asked, everywhere, world) < by_model


def test_a_camera_that_sees_all_round_sees_no_higher_than_its_angle():
    world = hall_of_landmark_visibility(Landmark(8, 5, z=EYE + 1.0))
    around = DifferentialDrive(field_of_view=(2 * np.pi, 2 * np.arctan(1.0 / 3.0)))  # from 3 m on
    away = Trajectory.from_poses(around, [(8, 5, 0), (14, 5, 0)])
    cost = trajectory_cost(LandmarkVisibility(near=20, far=30), away, world)
    assert cost == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("fov", [6.283, 2 * np.pi, 6.2832])
def test_an_angle_of_view_with_a_few_decimals_is_all_round(fov):
    world = hall_of_landmark_visibility(Landmark(8, 8, z=EYE))
    away = Trajectory.from_poses(MODEL, [(8, 7, -np.pi / 2), (8, 6, -np.pi / 2)])
    assert trajectory_cost(LandmarkVisibility(fov=fov), away, world) == pytest.approx(0.0, abs=1e-9)


def test_the_mean_stands_for_its_integral():
    assert LandmarkVisibility(1.0, 2.0, 3.0).integral == LandmarkBlindness(1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("bad", "text"),
    [
        ({"near": -1.0}, "near"),
        ({"near": 10.0}, "near"),
        ({"far": np.inf}, "far"),
        ({"far": np.nan}, "far"),
        ({"fov": 0.0}, "fov"),
        ({"fov": 7.0}, "fov"),
        ({"fov": np.nan}, "fov"),
    ],
)
@pytest.mark.parametrize("cls", [LandmarkVisibility, LandmarkBlindness])
def test_bad_parameters_are_named_for_landmark_visibility(cls, bad, text):
    with pytest.raises(CriterionError, match=text):
        cls(**bad)


def test_a_world_without_landmarks_is_refused():
    away = Trajectory.from_poses(MODEL, [(2, 5, 0), (15, 5, 0)])
    with pytest.raises(CriterionError, match="landmarks"):
        trajectory_cost(LandmarkVisibility(), away, hall_of_landmark_visibility())


WALL = shapely.box(0, 5, 10, 5.2)  # open from x = 10 to x = 16
NORTH, SOUTH = Landmark(2, 9, weight=3.0), Landmark(2, 1)


def hall_of_unseen_landmarks(*landmarks, obstacles=(WALL,)):
    return World.from_polygons(obstacles, extent=shapely.box(0, 0, 16, 10)).with_content(landmarks=landmarks)


def drive(*places):
    return Trajectory.from_poses(MODEL, [(x, y, 0) for x, y in places])


def test_what_stays_behind_the_wall_is_missed_by_its_weight():
    world = hall_of_unseen_landmarks(NORTH, SOUTH)
    assert trajectory_cost(UnseenLandmarks(far=30), drive((1, 3), (6, 3)), world) == 0.75
    assert trajectory_cost(UnseenLandmarks(far=30), drive((1, 7), (6, 7)), world) == 0.25
    assert trajectory_cost(UnseenLandmarks(far=30), drive((1, 3), (14, 3), (14, 9)), world) == 0.0


def test_the_running_value_falls_when_a_landmark_comes_into_sight():
    world = hall_of_unseen_landmarks(NORTH, SOUTH)
    route = Trajectory.from_poses(MODEL, [(1, 3, 0), (6, 3, 0), (14, 3, np.pi / 2), (14, 9, np.pi / 2), (2, 8, np.pi)])
    values = running_costs(UnseenLandmarks(far=30), route, world)
    # The line from (2, 9) past the wall's end (10, 5.2) to x = 14 is at y = 3.3: out of sight on the way along y = 3.
    assert values.tolist() == [0.75] * 3 + [0.0] * (len(values) - 3)
    assert (np.diff(values) <= 0).all()


def test_a_glance_counts_if_it_lasts_long_enough():
    # A slit 1 m wide, half way between the landmark and the way: 2 m of it see the landmark.
    walls = (shapely.box(0, 5, 7.5, 5.01), shapely.box(8.5, 5, 16, 5.01))
    world = hall_of_unseen_landmarks(Landmark(8, 9), obstacles=walls)
    past = drive((2, 1), (14, 1))
    lasts = 2.0 / MODEL.speed
    assert trajectory_cost(UnseenLandmarks(least=0.9 * lasts), past, world) == 0.0
    assert trajectory_cost(UnseenLandmarks(least=1.1 * lasts), past, world) == 1.0
    there_and_back = drive((2, 1), (14, 1), (2, 1))
    assert trajectory_cost(UnseenLandmarks(least=1.9 * lasts), there_and_back, world) == 0.0


def test_the_robot_is_judged_by_what_it_does_not_by_the_plan():
    world = hall_of_unseen_landmarks(Landmark(8, 8), obstacles=())
    route = drive((2, 2), (8, 2))
    executed = route.execution().duration
    assert executed > route.duration
    assert trajectory_cost(UnseenLandmarks(least=executed - 0.1), route, world) == 0.0
    assert trajectory_cost(UnseenLandmarks(least=executed + 0.1), route, world) == 1.0


def test_a_viewer_sees_within_reach_ahead_and_from_the_front():
    route = drive((2, 5), (6, 5))
    ahead, behind = Landmark(9, 5), Landmark(0.5, 5)
    assert (
        trajectory_cost(UnseenLandmarks(fov=2.0), route, hall_of_unseen_landmarks(ahead, behind, obstacles=())) == 0.5
    )
    assert (
        trajectory_cost(UnseenLandmarks(fov=2 * np.pi), route, hall_of_unseen_landmarks(ahead, behind, obstacles=()))
        == 0.0
    )
    assert trajectory_cost(UnseenLandmarks(far=2.9), route, hall_of_unseen_landmarks(ahead, obstacles=())) == 1.0
    assert trajectory_cost(UnseenLandmarks(far=3.1), route, hall_of_unseen_landmarks(ahead, obstacles=())) == 0.0
    turned_away, turned_to = (Landmark(9, 5, facing=facing) for facing in (0.0, np.pi))
    assert (
        trajectory_cost(UnseenLandmarks(), route, hall_of_unseen_landmarks(turned_away, turned_to, obstacles=())) == 0.5
    )


def test_what_the_camera_cannot_see_at_once_is_missed():
    """1.5 m up and 3 m ahead, at closest: 27 degrees, and 90 to the left when it is passed."""
    world = hall_of_unseen_landmarks(Landmark(9, 5, z=2.7), obstacles=())
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
def test_bad_parameters_are_named_for_unseen_landmarks(bad, text):
    with pytest.raises(CriterionError, match=text):
        UnseenLandmarks(**bad)
