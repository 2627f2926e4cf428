"""Verification finds what is wrong with a front, and nothing in one that is right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
import shapely

import hpop
from hpop.base import registry
from hpop.criteria.base import criterion
from hpop.criteria.costs import trajectory_costs
from hpop.models.collision.solid import SolidCollision
from hpop.models.driven import driven
from hpop.motions import Motions
from hpop.problems.problem import Problem
from hpop.problems.verify import collision_free, verify
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person, World

ROBOT = hpop.DifferentialDrive(radius=0.3, camera_height=1.2)
# A wall with a passage of 1 m at y in (2, 3); a shelf above the body but below the camera; a zone to keep out of.
WORLD = hpop.World.from_polygons(
    [shapely.box(2, 0, 3, 2), shapely.box(2, 3, 3, 5), (shapely.box(4, 4, 5, 5), (0.9, 1.0))],
    extent=shapely.box(0, 0, 6, 5),
    keep_out=shapely.box(5, 0, 6, 1),
)
START, GOAL = (1.0, 2.5, 0.0), (5.0, 2.5, 0.0)
DETOUR = [START, (4.0, 2.5, 0.0), (4.0, 3.0, 0.0), (5.0, 3.0, 0.0), GOAL]


def problem(**changes: object) -> Problem:
    asked = {"world": WORLD, "model": ROBOT, "start": START, "goal": GOAL, "criteria": ["obstruction", "length"]}
    return Problem(**(asked | changes))  # type: ignore[arg-type]


def front_of(asked: Problem, *trajectories: Trajectory, off: float = 0.0, **changes: object) -> hpop.Front:
    """Return a front that claims these trajectories, with costs that are off by ``off``."""
    costs = trajectory_costs(asked.criteria, trajectories, asked.world) + off
    declared: dict[str, object] = {
        "names": [c.name for c in asked.criteria],
        "units": [c.unit for c in asked.criteria],
        "groups": [c.group for c in asked.criteria],
        "quanta": [c.quantum for c in asked.criteria],
        "status": "complete",
        "certificate": "as given",
    }
    return hpop.Front.of(costs, trajectories, **(declared | changes))  # type: ignore[arg-type]


def path(*poses: tuple[float, float, float]) -> Trajectory:
    return Trajectory.from_poses(ROBOT, list(poses))


def shifted(trajectory: Trajectory, **by: float) -> Trajectory:
    """Return the trajectory with some states changed by a constant."""
    s = trajectory.states
    columns = {name: getattr(s, name) + by.get(name, 0.0) for name in s.names}
    return replace(trajectory, states=hpop.motions.States(**columns))


def test_a_front_that_a_planner_found_has_no_fault() -> None:
    asked = problem(criteria=["obstruction", "turns", "length"], goal=(4.6, 2.6, None))  # off the lattice
    found = asked.solve(step=0.5)
    assert len(found) > 0
    assert verify(asked, found) == []


def test_a_front_worked_out_by_hand_has_no_fault() -> None:
    asked = problem(criteria=["length"])
    assert verify(asked, front_of(asked, path(START, GOAL))) == []


def test_a_yaw_of_three_decimals_is_on_its_heading() -> None:
    asked = problem(start=(1.0, 1.0, 1.571), criteria=["length"])
    found = asked.solve(step=0.5)
    assert verify(asked, found) == []


def test_an_empty_front_has_no_fault() -> None:
    asked = problem()
    assert verify(asked, front_of(asked)) == []


@pytest.mark.parametrize("off", [1e-6, -0.25, 3.0])
def test_a_wrong_cost_is_found(off: float) -> None:
    asked = problem(criteria=["length"])
    (fault,) = verify(asked, front_of(asked, path(START, GOAL), off=off))
    assert fault == f"trajectory 0: length is saved as {4 + off:.9g}, re-evaluated 4"


def test_a_wrong_reported_value_is_found() -> None:
    asked = problem()
    straight = path(START, GOAL)
    front = front_of(
        problem(criteria=["length"]), straight, reported=[[0.5]], reported_names=["obstruction"], reported_units=["1"]
    )
    (fault,) = verify(asked, front)
    assert fault.startswith("trajectory 0: obstruction is saved as 0.5, re-evaluated ")


@pytest.mark.parametrize(
    ("trajectory", "said"),
    [
        (path(START, (1.0, 1.0, 0.0), (5.0, 1.5, 0.0), GOAL), "trajectory 0 collides"),  # through the wall
        (path(START, (1.5, 2.2, 0.0), (4.0, 2.2, 0.0), GOAL), "trajectory 0 collides"),  # 0.2 m beside it
        (path(START, (4.5, 2.5, 0.0), (4.5, 4.2, 0.0), GOAL), "trajectory 0 collides"),  # the mast hits the shelf
        (path(START, (4.0, 2.5, 0.0), (5.0, 0.8, 0.0), GOAL), "trajectory 0 collides"),  # through the zone
        (path(START, (0.1, 2.5, 0.0), GOAL), "trajectory 0 collides"),  # over the border
        (path(START, (-1.0, 2.5, 0.0), GOAL), "trajectory 0 leaves the map"),
        (path((1.0, 2.4, 0.0), GOAL), "trajectory 0 does not begin at the start"),
        (path((1.0, 2.5, 0.1), (1.0, 2.5, 0.0), GOAL), "trajectory 0 does not begin at the start"),
        (path(*DETOUR[:-1], (4.6, 4.0, 0.0)), "trajectory 0 collides"),
        (path(START, GOAL, (5.0, 2.5, 1.0)), "trajectory 0 does not end with the goal's heading"),
        (path(START, (1.2, 2.5, 0.0), (1.4, 2.5, 0.0)), "trajectory 0 ends 3.600 m from the goal"),
        (shifted(path(*DETOUR), yaw=0.4), "trajectory 0 goes sideways or backwards in motion 0, a move"),
        (shifted(path(START, GOAL), yaw=np.pi), "trajectory 0 goes sideways or backwards in motion 0, a move"),
        (shifted(path(START, GOAL), x=1e12), "trajectory 0 leaves the map"),
        (shifted(path(START, GOAL), yaw=1e12), "trajectory 0 leaves the map"),
    ],
)  # fmt: skip
def test_a_wrong_trajectory_is_found(trajectory: Trajectory, said: str) -> None:
    asked = problem(criteria=["turns"])  # its cost does not depend on where the trajectory is
    assert said in verify(asked, front_of(asked, trajectory))


def test_the_camera_passes_over_a_shelf_only_if_the_mast_is_short() -> None:
    beside = path((4.0, 2.5, 0.0), (4.5, 2.5, 0.0), (4.5, 4.5, np.pi / 2))
    for height, free in ((1.2, False), (0.85, True)):
        asked = problem(model=replace(ROBOT, camera_height=height, body_height=0.3))
        moved = replace(beside, model=asked.model)
        assert collision_free(asked, [moved]).tolist() == [free]


def test_only_the_trajectories_that_collide_are_named() -> None:
    asked = problem()
    good, bad = path(START, GOAL), path(START, (2.5, 1.0, 0.0), GOAL)
    assert collision_free(asked, [good, bad, good]).tolist() == [True, False, True]
    assert collision_free(asked, []).tolist() == []


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"units": ["km"]}, "length is saved in 'km', but its unit is 'm'"),
        ({"groups": ["R"]}, "length is saved with group 'R'"),
        ({"quanta": [0.5]}, "quantum 0.5"),
        ({"names": ["lenght"]}, "costs of lenght are saved, but are not among the problem's criteria"),
        ({"names": ["lenght"]}, "costs of length are not saved, although they are among the problem's criteria"),
    ],
)
def test_wrong_declarations_are_found(changes: dict[str, object], said: str) -> None:
    asked = problem(criteria=["length"])
    faults = verify(asked, front_of(asked, path(START, GOAL), **changes))
    assert any(said in fault for fault in faults)


def test_criteria_with_memory_are_verified_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry.criteria, "_types", dict(registry.criteria))

    @criterion("elapsed", group="C", unit="s", aggregate="trajectory")
    @dataclass(frozen=True)
    class Elapsed:
        def cost(self, m: Motions) -> np.ndarray:
            return np.cumsum(m.duration)

    asked = problem(criteria=[Elapsed(), "length"])
    straight = path(START, GOAL)
    assert verify(asked, front_of(asked, straight)) == []
    assert len(verify(asked, front_of(asked, straight, off=0.1))) == 2


@pytest.mark.parametrize("break_it", [lambda x: x * (1 + 1e-12), lambda x: x + 1e-10])
def test_the_order_of_a_sum_is_no_fault(break_it: Callable[[float], float]) -> None:
    asked = problem(criteria=["length"])
    assert verify(asked, front_of(asked, path(START, GOAL), off=break_it(4.0) - 4.0)) == []


# Curves

RAMP, BRAKE = (1.0, 0.0, 1.0), (-1.0, 0.0, 1.0)


def swerving() -> Trajectory:
    """Through the passage and on, a little to the left, to the right and back, at 0.9 m/s."""
    bends = [(0.0, sign * 0.2, 0.5) for sign in (1, -1, -1, 1, -1, 1, 1, -1)]
    return driven(ROBOT, START, [(0.9, 0.0, 1.0), *bends, (-0.9, 0.0, 1.0)])


def driven_problem(goes: Trajectory, **changes: object) -> Problem:
    """Return the problem whose goal is the end of a trajectory."""
    return problem(goal=(float(goes.states.x[-1]), float(goes.states.y[-1]), None), **changes)


def test_a_curve_that_a_robot_can_drive_has_no_faults():
    goes = swerving()
    assert verify(driven_problem(goes), front_of(driven_problem(goes), goes)) == []


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"speed": 0.5}, "drives faster than its wheels can turn in motion 0"),
        ({"acceleration": 0.5, "turn_acceleration": 1.0}, "speeds up or turns harder than its wheels can in motion 0"),
    ],
)
def test_wheels_beyond_the_limits_are_found(changes, fault):
    goes = swerving()
    slow = replace(ROBOT, **changes)
    asked = driven_problem(goes, model=slow)
    found = verify(asked, front_of(asked, replace(goes, model=slow)))
    assert any(fault in one for one in found), found


def test_a_curve_that_goes_back_is_found():
    goes = driven(ROBOT, START, [(-0.5, 0.2, 1.0), (0.5, -0.2, 1.0)])
    asked = driven_problem(goes)
    assert any(
        "goes sideways or backwards in motion 0, a drive" in fault for fault in verify(asked, front_of(asked, goes))
    )


def test_a_curve_through_a_wall_is_found():
    goes = driven(ROBOT, START, [RAMP, (0.0, 2.0, 0.4), (0.0, -2.0, 0.4), (0.0, 0.0, 1.0), BRAKE])
    assert not collision_free(problem(), [goes])[0]
    assert collision_free(problem(), [swerving()])[0]


# Large fronts


def test_what_trajectories_share_is_checked_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """However many go there: the effort is that of the distinct motions, and it is told how far it is."""
    looked: list[int] = []
    free = SolidCollision.motions_free
    monkeypatch.setattr(SolidCollision, "motions_free", lambda self, m: looked.append(len(m)) or free(self, m))
    asked, detour = problem(criteria=["length"]), path(*DETOUR)
    assert collision_free(asked, [detour]).all()
    once, told = sum(looked), list[str]()
    looked.clear()
    fault = path(START, (2.5, 2.5, 0.0), (2.5, 1.0, 0.0))
    assert collision_free(asked, [detour] * 500).all()
    assert sum(looked) == once
    costs = [[float(i)] for i in range(3)]
    front = hpop.Front.of(
        [[*c, -c[0]] for c in costs], [detour, fault, detour], names=["length", "x"], units=["m", "1"],
        quanta=[1e-6, 1.0], status="complete", certificate="as given",
    )  # fmt: skip
    found = verify(asked, front, say=told.append)
    assert "trajectory 1 collides" in found
    assert not {"trajectory 0 collides", "trajectory 2 collides"} & set(found)
    assert any("length of 0 of" in one for one in told)
    assert any("collisions of 0 of" in one for one in told)


def test_contact_of_what_is_executed_is_told_where_the_plan_has_none():
    """At 3 m/3 s the plan passes a crossing person by 0.1 m; from rest the robot is there half a second later."""
    crosses = Person(4.0, -0.51, velocity=(0.0, 0.9), until=7.0, name="Ada")
    world = World.from_polygons([], extent=shapely.box(0, -2, 8, 8)).with_content(people=[crosses])
    asked = problem(world=world, start=(1, 3, 0), goal=(5, 3, 0))
    plan = path((1, 3, 0), (5, 3, 0))
    times = np.arange(0.0, 6.0, 0.01)
    least = [
        np.hypot(s.x - crosses.at(times)[0], s.y - crosses.at(times)[1]).min() - crosses.radius - ROBOT.radius
        for s in (plan.at(times), plan.execution().at(times))
    ]
    assert least[0] > 0.01 > -0.1 > least[1]
    faults = verify(asked, front_of(asked, plan))
    assert len(faults) == 1
    assert faults[0].startswith("trajectory 0, as it is executed, touches Ada at 3.")
