"""Criteria of the camera ask for its pose and twist, whatever moves it: a head, its base, both, or software."""

import math
from dataclasses import replace

import numpy as np
import pytest

import hpop
from hpop.base.registry import criteria
from hpop.criteria.base import make_criterion
from hpop.criteria.costs import motion_costs, trajectory_cost
from hpop.motions import Motions, States
from hpop.motions.symbolic import SymbolicMotions
from hpop.testing import random_world
from hpop.world.content.content import Landmark
from tests.own_criteria import NAMES, own_criterion

VIEW = (1.9, 0.9)
DRIVE = hpop.DifferentialDrive(field_of_view=VIEW, seat=(0.1, 0.0, 0.5))
HEAD = hpop.PanTilt(
    replace(DRIVE, field_of_view=None),
    tilt=(-1.0, 1.0),
    pan_rate=DRIVE.turn_rate,
    pan_acceleration=DRIVE.turn_acceleration,
    tilt_rate=DRIVE.turn_rate,
    tilt_acceleration=DRIVE.turn_acceleration,
    field_of_view=VIEW,
)
ROOM = random_world(np.random.default_rng(3))
HEIGHTS = np.random.default_rng(0).uniform(0.2, 3.0, len(ROOM.content.landmarks))
WORLD = ROOM.with_content(
    people=ROOM.content.people,
    groups=ROOM.content.groups,
    zones=ROOM.content.zones,
    landmarks=[replace(mark, z=float(z)) for mark, z in zip(ROOM.content.landmarks, HEIGHTS, strict=True)]
    + [Landmark(6.0, 4.0, z=2.0), Landmark(1.0, 8.0, z=0.5, weight=2.0)],
)
PLACE = 5.0, 4.5
JOINTED = [name for name in NAMES if "joints" in criteria[name].requires]
EVERY = [name for name in NAMES if name not in JOINTED]
OF_CAMERA = [name for name in EVERY if "camera" in criteria[name].requires]


def head(rows, *kinds):
    """Return a trajectory of a robot with a head through states (x, y, yaw, pan, tilt)."""
    columns = dict(zip(HEAD.space.names, np.array(rows, float).T, strict=True))
    return hpop.Trajectory(HEAD, States(**columns), kinds)


def drives(model, *poses, kinds):
    columns = dict(zip(("x", "y", "yaw"), np.array(poses, float).T, strict=True))
    return hpop.Trajectory(model, States(**columns), kinds)


def agree(one, other, names):
    """Check that criteria have equal values on two trajectories; return those above 0."""
    some = set()
    for name in names:
        expected, found = (trajectory_cost(own_criterion(name), trajectory, WORLD) for trajectory in (one, other))
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-9), name
        some |= {name} if expected else set()
    return some


def test_the_criteria_of_the_camera_are_known():
    assert len(OF_CAMERA) >= 22
    assert {"optic_flow", "landmark_visibility", "sickness", "net_misalignment", "heading_mismatch"} <= {*OF_CAMERA}


@pytest.mark.parametrize("angle", [1.3, -math.pi / 2])
def test_a_pan_is_to_the_user_what_a_turn_is(angle):
    panned = head([(*PLACE, 0.4, 0.1, 0), (*PLACE, 0.4, 0.1 + angle, 0)], "pan")
    turned = drives(DRIVE, (*PLACE, 0.5), (*PLACE, 0.5 + angle), kinds=("turn",))
    some = agree(turned, panned, OF_CAMERA)
    rotations = {"rotation", "rotation_time", "turns", "net_winding", "angular_acceleration"}
    assert some >= rotations | {"optic_flow", "peak_optic_flow", "landmark_visibility", "obstruction"}
    assert "heading_mismatch" not in some
    assert trajectory_cost(make_criterion("length"), panned, WORLD) == 0.0


def test_a_head_that_turns_back_is_to_the_user_a_camera_that_stands():
    back = head([(*PLACE, 0.4, 0.1, 0), (*PLACE, 1.9, -1.4, 0)], "unwind")
    stands = hpop.ViewModel(DRIVE, "unwound", 0.5)
    agree(drives(stands, (*PLACE, 0.4), (*PLACE, 1.9), kinds=("turn",)), back, EVERY)
    moved = {"rotation", "rotation_time", "turns", "net_winding", "angular_acceleration", "optic_flow", "sickness"}
    for name in moved | {"peak_optic_flow", "net_misalignment", "orientation_retention", "jerk", "msdv"}:
        assert trajectory_cost(make_criterion(name), back, WORLD) == pytest.approx(0.0, abs=1e-12), name


def test_a_view_that_a_head_holds_on_a_way_costs_what_one_that_software_holds_does():
    """In every criterion, those of the base included: only who holds the view differs."""
    poses = [(2, 2, 0.0), (4, 2, 0.0), (4, 2, math.pi / 2), (4, 5, math.pi / 2), (4, 5, -0.5)]
    kinds = "move", "turn", "move", "turn"
    held = [(x, y, yaw, 0.3 - yaw, 0.0) for x, y, yaw in poses]
    by_head = head(held, *("unwind" if kind == "turn" else kind for kind in kinds))
    by_software = drives(hpop.ViewModel(DRIVE, "unwound", 0.3), *poses, kinds=kinds)
    some = agree(by_software, by_head, EVERY)
    assert some >= {"heading_mismatch", "optic_flow", "landmark_blindness", "msdv", "sickness", "energy", "length"}


def test_a_camera_that_turns_with_its_base_is_one_that_turns():
    """Pan and turn one after the other, against turns alone; and moves with the head aside."""
    both = head([(*PLACE, 0.0, 0.0, 0), (*PLACE, 0.7, 0.0, 0), (*PLACE, 0.7, -0.9, 0)], "turn", "pan")
    agree(drives(DRIVE, (*PLACE, 0.0), (*PLACE, 0.7), (*PLACE, -0.2), kinds=("turn", "turn")), both, OF_CAMERA)


def test_a_tilt_turns_the_view_about_a_level_axis():
    up = head([(*PLACE, 0.4, 0.1, -0.2), (*PLACE, 0.4, 0.1, 0.7)], "tilt")
    like = drives(DRIVE, (*PLACE, 0.5), (*PLACE, 1.4), kinds=("turn",))
    alike = ["rotation", "rotation_time", "angular_acceleration", "obstruction", "openness", "passing_distance", "jerk"]
    assert agree(like, up, alike) >= {"rotation", "rotation_time", "angular_acceleration"}
    for name in ("turns", "net_winding", "orientation_retention", "net_misalignment", "heading_mismatch", "msdv"):
        assert trajectory_cost(make_criterion(name), up, WORLD) == 0.0, name
    assert trajectory_cost(make_criterion("sickness"), up, WORLD) > 0.0  # the vertical that she sees tilts


@pytest.mark.cases("view1")
@pytest.mark.parametrize("view", [None, VIEW])
def test_a_tilt_flows_most_straight_ahead_and_not_at_all_to_the_side(view):
    up = head([(*PLACE, 0.4, 0.1, -0.2), (*PLACE, 0.4, 0.1, 0.7)], "tilt")
    up = replace(up, model=replace(HEAD, field_of_view=view))
    flow = trajectory_cost(make_criterion({"optic_flow": {"bearings": 180}}), up, WORLD)
    half = math.pi if view is None else view[0] / 2
    mean = 2 / math.pi if view is None else math.sin(half) / half  # of |cos b| within half the view
    assert flow == pytest.approx(0.9 * mean, rel=2e-3)
    fastest = min(HEAD.tilt_rate, math.sqrt(0.9 * HEAD.tilt_acceleration))
    peak = trajectory_cost(make_criterion({"peak_optic_flow": {"bearings": 180}}), up, WORLD)
    assert peak == pytest.approx(fastest, rel=1e-3)


def test_who_looks_down_while_she_is_driven_pays_for_the_angle_in_space():
    look = head([(2, 2, 0.0, 0.6, -0.5), (6, 2, 0.0, 0.6, -0.5)], "move")
    angle = math.acos(math.cos(0.6) * math.cos(0.5))
    found = trajectory_cost(make_criterion("heading_mismatch"), look, WORLD)
    assert found == pytest.approx(4 / DRIVE.speed * angle, rel=1e-9)


def test_a_landmark_overhead_comes_into_view_as_the_head_tilts_up():
    """2 m ahead and 1.5 m up, 36.9 degrees: in view of 0.9 rad, 25.8 degrees to either side, from a tilt of 11.1 on."""
    x, y = PLACE
    world = hpop.World.from_polygons([], extent=ROOM.extent).with_content(
        landmarks=[Landmark(x + 2.0, y, z=DRIVE.camera_height + 1.5)]
    )
    tilts, lasts = [], []
    for tilt in np.radians([0.0, 11.0, 11.2, 40.0]):
        ends = (
            States(**{n: np.array([v]) for n, v in zip(HEAD.space.names, (x + d, y, 0, 0, tilt), strict=True)})
            for d in (0.0, 1e-3)
        )
        moves = Motions(world, HEAD, HEAD.laws["move"], *ends)
        tilts.append(float(make_criterion("landmark_blindness").cost(moves)[0] / moves.duration[0]))
        lasts.append(
            trajectory_cost(
                make_criterion("unseen_landmarks"), head([(x, y, 0, 0, tilt), (x + 1e-3, y, 0, 0, tilt)], "move"), world
            )
        )
    assert tilts == pytest.approx([1.0, 1.0, 0.0, 0.0], abs=1e-9)
    assert lasts == [1.0, 1.0, 0.0, 0.0]


@pytest.mark.cases("move")
@pytest.mark.parametrize("kind", ["move", "pan", "tilt", "unwind"])
def test_symbols_cost_what_numbers_do_whatever_the_head_does(kind):
    """With 4 bearings, for the sake of time. A landmark at the edge of the view is seen in part on symbols."""
    rng = np.random.default_rng(4)
    start = {"x": rng.uniform(4.6, 5.4, 5), "y": rng.uniform(4.2, 4.8, 5), "yaw": rng.uniform(-3, 3, 5)}
    start |= {"pan": rng.uniform(-1, 1, 5), "tilt": rng.uniform(-0.3, 0.3, 5)}
    turn = rng.uniform(0.1, 0.4, 5)
    change = {
        "move": {"x": 0.2 * np.cos(start["yaw"]), "y": 0.2 * np.sin(start["yaw"])},
        "pan": {"pan": turn},
        "tilt": {"tilt": turn},
        "unwind": {"yaw": turn, "pan": -turn},
    }[kind]
    end = {name: value + change.get(name, 0.0) for name, value in start.items()}
    motions = Motions(WORLD, HEAD, HEAD.laws[kind], States(**start), States(**end), panels=1)
    symbols = SymbolicMotions.of(motions)
    flow = {"bearings": 4}
    for spec in ("rotation", "heading_mismatch", "landmark_blindness", {"optic_flow": flow}, {"peak_optic_flow": flow}):
        criterion = make_criterion(spec)
        value, jacobian = symbols.values_and_jacobian(criterion.cost(symbols.motions))
        share = 2e-3 if spec == "landmark_blindness" else 1e-6
        assert value == pytest.approx(motion_costs(criterion, motions), rel=share, abs=1e-9), spec
        assert np.isfinite(jacobian).all()
