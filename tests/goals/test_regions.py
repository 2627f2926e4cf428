"""Goals in space: states that inverse kinematics finds bring the body where it shall be, in the words of vectors."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import QueryError
from hpop.goals import CameraAt, LookAt, Region, ToolAt
from hpop.goals.region import APART, InverseKinematics
from hpop.models.serial_arm import SerialArm
from hpop.motions import States
from hpop.problems.problem import Problem
from tests.jointed import Jointed, states_of

WORLD = hpop.World.from_polygons([shapely.box(2, 0, 3, 2)], extent=shapely.box(0, 0, 6, 4))
ARM, HEAD, BASE = Jointed(), hpop.PanTilt(), hpop.DifferentialDrive(radius=0.2, camera_height=1.2)
ENDLESS = hpop.PanTilt(pan="all round", tilt=(-1.0, 1.0))
STARTS: dict[Any, Any] = {ARM: (0, 0, 0), HEAD: (1, 1, 0, 0, 0), BASE: (1, 1, 0), ENDLESS: (1, 1, 0, 0, 0)}
TARGET = (4.0, 3.0, 1.5)
UPRIGHT = (0.3, 0.2, 0.1)

# Where the arm's camera can be at all: beyond the end of a link of 0.4 m that stands 0.3 m above the floor.
REGIONS: list[tuple[Any, Any]] = [
    (HEAD, LookAt(TARGET, (0.5, 1.5))),
    (ENDLESS, LookAt(TARGET, (0.5, 1.5), roll=0.0)),
    (BASE, LookAt((4.0, 3.0, 1.2), (0.5, 1.5))),
    (BASE, LookAt(TARGET, (0.5, 3.0), angle_tolerance=math.radians(10))),  # it can do so from afar alone
    (ARM, LookAt((1.0, 0.3, 0.4), (0.4, 0.8), roll=0.4)),
    (HEAD, CameraAt((4.5, 1.5, HEAD.base.camera_height), yaw_pitch_roll=(2.0, 0.3, 0.0))),
    (HEAD, CameraAt((4.5, 1.5, HEAD.base.camera_height), direction=(-3.0, 1.0, 1.0))),
    (HEAD, ToolAt((4.5, 1.5, 0.0), body="base")),
]


def asked(model: Any, goal: Any) -> Problem:
    return Problem(WORLD, model, STARTS[model], goal, ["duration"])


def drawn(model: Any, goal: Any, count: int = 50, seed: int = 0) -> States:
    problem = asked(model, goal)
    return problem.target.states(problem, np.random.default_rng(seed), count)


def vectors(model: Any, body: str, states: States) -> dict[str, Any]:
    """Place and axes (M, 3) of a body."""
    pose = model.pose(body, states)
    named = {"place": (pose.x, pose.y, pose.z), "ahead": pose.ahead, "left": pose.left, "up": pose.up}
    return {
        name: np.stack([np.broadcast_to(part, (states.size,)) for part in given], 1) for name, given in named.items()
    }


def angle(one: Any, other: Any) -> Any:
    """Between vectors (M, 3), by their cosine."""
    cosine = (one * other).sum(-1) / (np.linalg.norm(one, axis=-1) * np.linalg.norm(other, axis=-1))
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def misses(model: Any, goal: Any, states: States) -> tuple[Any, Any]:
    """By how many m and rad the states are beyond what a goal asks for."""
    at = vectors(model, goal.body, states)
    if isinstance(goal, LookAt):
        offset = np.array(goal.target) - at["place"]
        apart = np.linalg.norm(offset, axis=1)
        beyond = np.maximum(np.maximum(goal.distance[0] - apart, apart - goal.distance[1]), 0.0)
        turned = angle(at["ahead"], offset)
        if goal.roll is not None:
            turned = np.hypot(turned, np.arctan2(at["left"][:, 2], at["up"][:, 2]) - goal.roll)
        return beyond, turned
    beyond = np.linalg.norm(at["place"] - goal.position, axis=1)
    if goal.direction is not None:
        return beyond, angle(at["ahead"], np.array(goal.direction))
    if goal.yaw_pitch_roll is None:
        return beyond, np.zeros(states.size)
    yaw, pitch, _ = goal.yaw_pitch_roll
    ahead = np.array([math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), math.sin(pitch)])
    return beyond, np.hypot(angle(at["ahead"], ahead), angle(at["left"], np.array([-math.sin(yaw), math.cos(yaw), 0])))


@pytest.mark.parametrize(("model", "goal"), REGIONS)
def test_states_of_a_goal_bring_the_body_where_it_shall_be(model: Any, goal: Any) -> None:
    states = drawn(model, goal)
    metres, radians = misses(model, goal, states)
    most_metres, most_radians = goal.tolerances
    assert metres.max() <= 1.001 * most_metres
    assert radians.max() <= 1.001 * most_radians + 1e-7  # an arc cosine knows no less
    assert goal.reached(model, states).all()
    space = model.space
    for name, low, high in zip(space.names, space.low, space.high, strict=True):
        column = getattr(states, name)
        assert name in space.turning or ((column >= low) & (column <= high)).all()


def test_who_is_off_by_more_than_the_tolerance_has_not_reached_it() -> None:
    goal = LookAt(TARGET, (0.5, 1.5))
    states = drawn(ENDLESS, goal)
    for share, there in ((0.99, True), (1.01, False)):
        tilted = States(**states.__dict__ | {"tilt": states.tilt + share * goal.angle_tolerance})
        assert (goal.reached(ENDLESS, tilted) == there).all()


@pytest.mark.parametrize(
    "goal",
    [
        LookAt((1.0, 0.3, 0.4), (0.3, 0.9), roll=0.4),
        CameraAt(UPRIGHT, yaw_pitch_roll=(0.2, -0.4, 1.0)),
        CameraAt(UPRIGHT, direction=(1.0, 2.0, -1.0)),
    ],
    ids=str,
)
def test_rates_are_the_derivatives_of_coordinates(goal: Region) -> None:
    rng = np.random.default_rng(1)
    rows, rates, step = rng.uniform(-1.0, 1.0, (200, 3)), rng.uniform(-1.0, 1.0, (200, 3)), 1e-6
    before, after = (
        np.stack(goal.coordinates(ARM.pose("camera", states_of(ARM, rows + side * step * rates)))) for side in (-1, 1)
    )
    states = states_of(ARM, rows)
    found = np.stack(goal.rates(ARM.pose("camera", states), ARM.twist("camera", states, states_of(ARM, rates))))
    np.testing.assert_allclose(found, (after - before) / (2 * step), atol=2e-8)


@pytest.mark.parametrize(
    ("goal", "states"),
    [
        (LookAt((1.0, 0.0, 1.2), (0.5, 1.5)), [(0, 0, math.pi, 0, 0)]),
        (CameraAt((0, 0, 1.2), direction=(2.0, 0.0, 0.0)), [(0, 0, math.pi, 0, 0), (0, 0, 0, math.pi, 0)]),
        (CameraAt((0, 0, 1.2), yaw_pitch_roll=(0, 0, 0)), [(0, 0, math.pi, 0, 0), (0, 0, math.pi / 2, math.pi / 2, 0)]),
        (CameraAt((0, 0, 1.2), yaw_pitch_roll=(0, 0, math.pi)), [(0, 0, 0, 0, 0), (0, 0, math.pi, 0, 0)]),
        (CameraAt((0, 0, 1.2), yaw_pitch_roll=(0, math.pi, 0)), [(0, 0, 0, 0, 0)]),
    ],
)
def test_a_body_that_is_turned_by_half_a_turn_has_not_reached_it(goal: Any, states: Any) -> None:
    assert not goal.reached(HEAD, states_of(HEAD, states)).any()


@pytest.mark.parametrize("down", [-1.0, 1.0])
def test_a_camera_that_looks_straight_up_or_down_has_no_roll_that_could_be_wrong(down: float) -> None:
    """Off the vertical by less than a millionth, its roll is never off; by more, it is."""
    tilts = down * (math.pi / 2 - np.array([0.0, 9e-7, 2e-6, 0.01]))
    states = states_of(HEAD, [(0, 0, 0, 0, tilt) for tilt in tilts])
    camera = HEAD.pose("camera", states)
    place = (float(camera.x[0]), float(camera.y[0]), float(camera.z[0]) + down)
    for roll in (1.0, math.pi):
        goal = LookAt(place, (0.5, 1.5), roll=roll)
        *_, off = goal.coordinates(camera)
        assert (off == 0.0).tolist() == goal.reached(HEAD, states).tolist() == [True, True, False, False]


def test_the_same_seed_finds_the_same_states_and_another_finds_others() -> None:
    one, same, other = (drawn(HEAD, REGIONS[0][1], seed=seed) for seed in (3, 3, 4))
    assert all((getattr(one, name) == getattr(same, name)).all() for name in HEAD.space.names)
    assert (one.x != other.x).all()


def test_distances_are_drawn_from_the_whole_band() -> None:
    states = drawn(HEAD, LookAt(TARGET, (0.5, 1.5)), 200)
    x, y, z = TARGET
    apart = np.sqrt((states.x - x) ** 2 + (states.y - y) ** 2 + (HEAD.base.camera_height - z) ** 2)
    assert np.histogram(apart, np.linspace(0.5, 1.5, 5))[0].min() > 25


def test_a_pose_that_few_states_reach_has_those_few_and_each_once() -> None:
    """The arm can roll alone where its camera is on the axis: two states a pose, one of them over its back."""
    place = (0.3, 0.1, 0.4)
    camera = ARM.pose("camera", states_of(ARM, [place]))
    goal = CameraAt(
        tuple(float(part[0]) for part in (camera.x, camera.y, camera.z)),
        yaw_pitch_roll=tuple(float(part[0]) for part in (camera.yaw, camera.pitch, camera.roll)),
    )
    states = drawn(ARM, goal, 30)
    rows = np.stack([getattr(states, name) for name in ARM.space.names], axis=1)
    assert 1 <= len(rows) < 30
    assert np.abs(rows - place).max(axis=1).min() < 1e-6
    apart = np.linalg.norm(rows[:, None] - rows, axis=2) + 9.0 * np.eye(len(rows))
    assert apart.min() > APART


def test_a_state_that_turns_is_found_once_whatever_whole_turns_it_has() -> None:
    kinematics = InverseKinematics(ARM, ARM.space, LookAt((1, 0, 0), (0.1, 2)))
    rows = np.array([[0.1, 0.2, 3.1415], [0.1, 0.2, -3.1415], [0.1, 0.2, 1.0]])
    np.testing.assert_array_equal(kinematics.distinct(rows), rows[[0, 2]])


@pytest.mark.parametrize(
    ("model", "goal", "said"),
    [
        (ARM, LookAt((5.0, 0.0, 0.35), (0.2, 0.4)), r"look_at \(5, 0, 0\.35\) from 0\.2 to 0\.4 m .*is 4\.\d+ m and"),
        (BASE, LookAt(TARGET, (0.5, 1.5)), r"the nearest state found is .* m and 1\d degrees off"),
        (
            HEAD,
            CameraAt((1, 3, 9)),
            r"camera_at \(1, 3, 9\) cannot be reached: .* is 7\.8 m and 0 degrees off; move the goal",
        ),
        (HEAD, CameraAt((11, 3, 1.2)), "is 5 m and 0 degrees off"),  # the map ends before
    ],
)
def test_a_goal_out_of_reach_is_refused_with_how_far_the_nearest_is_off(model: Any, goal: Any, said: str) -> None:
    with pytest.raises(QueryError, match=said):
        drawn(model, goal)


@dataclass(frozen=True)
class Counted(Jointed):
    """Counts in how many states it is asked where its camera is."""

    def pose(self, body: str, s: States) -> Any:
        ASKED.append(s.size)
        return super().pose(body, s)


ASKED: list[int] = []


def test_a_state_costs_less_than_two_hundred_poses() -> None:
    ASKED.clear()
    STARTS[Counted()] = STARTS[ARM]
    assert drawn(Counted(), LookAt((1.0, 0.3, 0.4), (0.3, 1.2)), 1000).size == 1000
    assert sum(ASKED) < 200 * 1000


@pytest.mark.cases(but=("camera_at (0.45, 0.15, 0.5), yaw 28.65, pitch -57.3 and roll 0 degrees",))
@pytest.mark.parametrize(
    "goal",
    [
        LookAt((0.6, 0.0, 0.3), (0.2, 0.4), roll=0.0),
        CameraAt((0.45, 0.15, 0.5), yaw_pitch_roll=(0.5, -1.0, 0.0)),
        ToolAt((0.4, 0.2, 0.5), direction=(0.0, 0.0, -1.0)),
    ],
    ids=str,
)
def test_an_arm_of_seven_joints_finds_as_many_states_as_are_asked_for(
    goal: Any, shared_data: Callable[[str], Path]
) -> None:
    urdf = shared_data("mbm_panda") / "panda_spherized.urdf"
    arm = SerialArm.from_urdf(urdf, tip="panda_hand", acceleration=7.5)
    STARTS[arm] = (0, -0.5, 0, -2, 0, 1.5, 0.7)
    states = drawn(arm, goal, 100)
    assert states.size == 100
    metres, radians = misses(arm, goal, states)
    assert metres.max() <= goal.tolerances[0]
    assert radians.max() <= goal.tolerances[1]
    low, high = np.array(arm.space.low), np.array(arm.space.high)
    rows = np.stack([getattr(states, name) for name in arm.space.names], axis=1)
    assert ((rows >= low) & (rows <= high)).all()
