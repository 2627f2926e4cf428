"""A camera of changing height: compared with closed forms, brute force, and the plane at one height."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import make_criterion, trajectory_cost
from hpop.errors import OptionError
from hpop.models.laws import linear, rest_to_rest
from hpop.models.rigid import height_varies
from hpop.motions import StateSpace, integrated
from hpop.motions.symbolic import SymbolicMotions
from hpop.world.content.content import Landmark
from hpop.world.fields.obstruction import polygon_obstruction
from tests.jointed import Jointed, camera_at, moments, states_of, tour

WALLS = [
    (shapely.box(-3, -3, 3, 3).difference(shapely.box(-2, -1.5, 2.5, 1.5)), (-0.5, 1.5)),
    (shapely.box(0.9, 0.3, 1.2, 0.6), (0.0, 0.5)),
]
ROOM = hpop.World.from_polygons(WALLS, extent=shapely.box(-3, -3, 3, 3))
ARM = Jointed(foot=(0.0, 0.0, 0.3))


# Optic flow


def test_a_rotation_all_round_costs_a_quarter_of_pi_of_its_angle_and_peaks_at_its_rate():
    """In the open, about an axis through the camera: the mean of sin over the sphere."""
    model = hpop.World.from_polygons([], extent=shapely.box(-3, -3, 3, 3))
    turn = tour(Rolling(), [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0)])
    assert trajectory_cost(make_criterion({"optic_flow": {"bearings": 60}}), turn, model) == pytest.approx(
        2.0 * math.pi / 4, rel=1e-3
    )
    peak = trajectory_cost(make_criterion({"peak_optic_flow": {"bearings": 60}}), turn, model)
    assert peak == pytest.approx(1.0, rel=1e-2)


class Rolling(Jointed):
    """The camera at the end of the link: its roll is about its own place."""

    def _frames(self, s):
        axes, origins, _, camera = super()._frames(s)
        return axes, origins, origins[2], camera


def inner_wall(place, directions):
    """Distance (K,), m, from a place within the room to its walls, by their inner planes alone."""
    with np.errstate(divide="ignore"):
        far = np.where(directions[:, :2] > 0, np.array([2.5, 1.5]), np.array([-2.0, -1.5]))
        return np.min(np.where(directions[:, :2] != 0, (far - place[:2]) / directions[:, :2], np.inf), axis=1)


@pytest.mark.cases(1)
@pytest.mark.parametrize("view", [(1.4, 0.5), (0.6, 0.4)])
def test_flow_is_how_fast_points_of_the_walls_move_in_the_picture(view):
    """Points met by rays of the view, seen again a moment later: the angle between, over the moment."""
    tall = hpop.World.from_polygons([(WALLS[0][0], (-9.0, 9.0))], extent=ROOM.extent)
    model = Jointed(foot=ARM.foot, field_of_view=view)
    trajectory = tour(model)
    rng, h = np.random.default_rng(0), 1e-5
    times, step, *_ = moments(trajectory, 400)
    mean, largest = [], 0.0
    for t in times:
        z = rng.uniform(-math.sin(view[1] / 2), math.sin(view[1] / 2), 400)
        azimuth, across = rng.uniform(-view[0] / 2, view[0] / 2, 400), np.sqrt(1 - z * z)
        local = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)
        (place, axes), (later, turned) = (camera_at(trajectory, np.array([moment])) for moment in (t, t + h))
        directions = local @ axes[..., 0]
        points = place[:, 0] + inner_wall(place[:, 0], directions)[:, None] * directions
        seen = (points - later[:, 0]) @ turned[..., 0].T
        seen /= np.linalg.norm(seen, axis=1)[:, None]
        flow = np.linalg.norm(seen - local, axis=1) / h
        mean.append(flow.mean())
        largest = max(largest, flow.max())
    found = trajectory_cost(make_criterion({"optic_flow": {"bearings": 60}}), trajectory, tall)
    assert found == pytest.approx(np.sum(mean) * step, rel=0.01)
    peak = trajectory_cost(make_criterion({"peak_optic_flow": {"bearings": 60}}), trajectory, tall)
    assert 0.9 * largest < peak < 1.02 * largest


# The ball round the camera


@pytest.mark.parametrize("radius", [0.4, 1.0, 2.0])
def test_the_obstructed_fraction_is_that_of_the_closed_form_of_prisms(radius):
    trajectory = tour(ARM)
    *_, place, _ = moments(trajectory, 1500)
    phi = polygon_obstruction(ROOM.obstacles, *place, radius)
    exposure = trajectory_cost(make_criterion({"exposure": {"radius": radius}}), trajectory, ROOM)
    assert exposure / trajectory.duration == pytest.approx(phi.mean(), abs=1e-3)
    mean, worst = (
        trajectory_cost(make_criterion({name: {"radius": radius}}), trajectory, ROOM)
        for name in ("obstruction", "worst_obstruction")
    )
    assert mean == pytest.approx(exposure / trajectory.duration)
    assert worst == pytest.approx(phi.max(), abs=4e-3)


# Landmarks


def test_a_landmark_is_seen_while_it_is_in_the_picture_and_nothing_is_before_it():
    """By hand: components along the camera's axes, and points on the line of sight for the pillar and the walls."""
    model = Jointed(foot=ARM.foot, field_of_view=(1.2, 0.8))
    mark = Landmark(1.6, 1.0, z=0.4, weight=2.0)
    world = ROOM.with_content(landmarks=[mark, Landmark(0.0, -9.0, z=0.0)])  # the second is behind the wall
    trajectory = tour(model, [(-0.5, 0.0, 0.0), (1.2, 0.1, 0.5), (0.3, 1.1, -0.4)])
    _, step, place, (ahead, left, up) = moments(trajectory, 4000)
    d = np.array([mark.x, mark.y, mark.z])[:, None] - place
    x, y, z = (np.sum(axis * d, axis=0) for axis in (ahead, left, up))
    in_view = (np.abs(np.arctan2(y, x)) <= 0.6) & (np.abs(np.arctan2(z, np.hypot(x, y))) <= 0.4)
    along = place[:, None] + np.linspace(0, 1, 400)[None, :, None] * d[:, None]
    pillar = (np.abs(along[0] - 1.05) < 0.15) & (np.abs(along[1] - 0.45) < 0.15) & (along[2] > 0) & (along[2] < 0.5)
    seen = in_view & ~pillar.any(axis=0)
    assert 0.05 < seen.mean() < 0.95
    blindness = trajectory_cost(make_criterion("landmark_blindness"), trajectory, world)
    assert blindness == pytest.approx(np.sum(1 - seen * 2 / 3) * step, rel=0.03)
    missed = trajectory_cost(make_criterion("unseen_landmarks"), trajectory, world)
    assert missed == pytest.approx(1 / 3)


# A lift that drives at one height, against the plane


@dataclass(frozen=True)
class Rise:
    """The mast rises or sinks."""

    kind = "rise"
    varies = frozenset({"mast"})

    def phases(self, start, end):
        return rest_to_rest(np.abs(end.mast - start.mast), 0.5, 1.0)

    def interpolate(self, name, start, end, share):
        return linear(name, start, end, share)


class Raised:
    def __init__(self, pose, by):
        self.x, self.y, self.z = pose.x, pose.y, pose.z + by
        self.yaw, self.pitch, self.roll = pose.yaw, pose.pitch, pose.roll
        self.ahead, self.left, self.up = pose.ahead, pose.left, pose.up


@dataclass(frozen=True)
class Lift(hpop.DifferentialDrive):
    """A base whose camera is on a mast that rises."""

    @cached_property
    def space(self):
        p = super().space
        columns = ((*p.names, "mast"), (*p.units, "m"), (*p.low, 0.0), (*p.high, 1.0), (*p.weights, 1.0))
        return StateSpace(*columns, p.turning)

    @cached_property
    def laws(self):
        return {**super().laws, "rise": Rise()}

    def pose(self, body, states):
        pose = super().pose(body, states)
        return Raised(pose, states.mast) if body == "camera" else pose

    def twist(self, body, states, rates):
        twist = super().twist(body, states, rates)
        rise = rates.mast if body == "camera" else 0.0
        return SimpleNamespace(velocity=(*twist.velocity[:2], rise), rotation=twist.rotation)

    def body(self, name, motions):
        return integrated(name, motions)


def test_only_a_camera_whose_height_depends_on_the_state_rises():
    assert height_varies(ARM)
    assert height_varies(Lift())
    assert not height_varies(hpop.DifferentialDrive(camera_offset=(0.1, 0.2)))
    assert not height_varies(hpop.PanTilt())


@pytest.mark.parametrize("mast", [0.0, 0.4])
def test_a_lift_that_drives_at_one_height_pays_what_a_robot_of_that_height_does(mast):
    world = ROOM.with_content(landmarks=[Landmark(2.0, -1.0, z=0.6), Landmark(1.8, 0.9, z=0.2)])
    rows = [(-1.5, -1.0, 0.3), (1.0, -1.0 + 2.5 * math.tan(0.3), 0.3), (1.0, -1.0 + 2.5 * math.tan(0.3), 1.4)]
    low = hpop.DifferentialDrive(camera_height=0.3 + mast, radius=0.1)
    lift = Lift(camera_height=0.3, radius=0.1)
    planar = hpop.Trajectory(low, states_of(low, rows), ("move", "turn"))
    lifted = hpop.Trajectory(lift, states_of(lift, [(*row, mast) for row in rows]), ("move", "turn"))
    for spec, share in (
        ({"exposure": {"radius": 0.8}}, 0.06),  # the field smooths what is within .005 of it
        ({"enclosure": {"radius": 1.5}}, 0.02),
        ("landmark_blindness", 0.02),
        ("unseen_landmarks", 0.0),
        ("msdv", 1e-9),
    ):
        expected, found = (trajectory_cost(make_criterion(spec), t, world) for t in (planar, lifted))
        assert found == pytest.approx(expected, rel=share, abs=1e-9), spec


def test_a_lift_flows_as_it_rises():
    """Between two walls what is beside it sinks, as fast as it is near: the mean over directions, drawn at random."""
    lift = Lift(camera_height=0.3)
    rise = hpop.Trajectory(lift, states_of(lift, [(0, 0, 0, 0.0), (0, 0, 0, 0.5)]), ("rise",))
    corridor = hpop.World.from_polygons(
        [(shapely.box(-50, w, 50, w + 0.1), (-9, 9)) for w in (-1.1, 1.0)], extent=shapely.box(-3, -1.1, 3, 1.1)
    )
    d = np.random.default_rng(0).normal(size=(100_000, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    away = 1.0 / np.abs(d[:, 1])
    away = np.where(np.abs(0.5 + d[:, 2] * away) < 9.0, np.minimum(away, 20.0), 20.0)
    expected = 0.5 * np.mean(np.hypot(d[:, 0], d[:, 1]) / away)
    found = trajectory_cost(make_criterion({"optic_flow": {"bearings": 60}}), rise, corridor)
    assert found == pytest.approx(expected, rel=5e-3)


def test_rays_are_refused_on_symbols_in_words():
    _, motions = next(tour(ARM).batches(ROOM))
    symbols = SymbolicMotions.of(motions)
    for name in ("optic_flow", "landmark_blindness"):
        world = ROOM.with_content(landmarks=[Landmark(1.0, 0.0)])
        criterion = make_criterion(name)
        with pytest.raises(OptionError, match="rays in space need positions as numbers"):
            criterion.cost(replace(symbols.motions, world=world))
