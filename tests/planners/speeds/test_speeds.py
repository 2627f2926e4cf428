"""Robots with several speeds, through graphs, searches, tours and files; refusals that say what to do."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
import shapely

import hpop
from hpop.base.arrays import Column
from hpop.cli.report import driven_speeds, print_front
from hpop.criteria.base import criterion
from hpop.errors import ModelError, UnsupportedModel
from hpop.models import PanTilt
from hpop.models.base import Mount, Part, PlanarModel, plane_space
from hpop.models.laws import Spin, Turn
from hpop.models.speeds import speed_laws
from hpop.motions import Law, Motions, States, StateSpace
from hpop.planners.base import PlannerSpec
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.scenario import load_scenario
from hpop.testing import check_model
from hpop.trajectories.trajectory import Trajectory

ROOM, WALL = shapely.box(0, 0, 8, 6), shapely.box(3, 0, 4, 3)
WORLD = hpop.World.from_polygons([WALL], extent=ROOM)
SPEEDS = (0.5, 1.0, 1.5)
ROBOT = hpop.DifferentialDrive(radius=0.3, speeds=SPEEDS)
TURNING = hpop.DifferentialDrive(radius=0.3, speeds=(0.5, 1.0), turn_rates=(0.4, 1.5))
LATTICE = {"lattice": {"step": 0.5}}
CRITERIA = ("duration", "felt_acceleration", "speed_changes")


def problem(model: Any = ROBOT, criteria: Any = CRITERIA, **more: Any) -> Problem:
    given = {"world": WORLD, "start": (1, 1, 0), "goal": (6.9, 3.2, None), **more}
    return Problem(model=model, criteria=list(criteria), **given)


def speeds_of(front: Front) -> set[float]:
    """Return the speeds of all moves of a front, read from the durations and ways of its motions."""
    found = set[float]()
    for trajectory in front.trajectories:
        ways = np.hypot(np.diff(trajectory.states.x), np.diff(trajectory.states.y))
        moves = ways > 1e-9
        found |= set(np.round(ways[moves] / trajectory.durations[moves], 9).tolist())
    return found


@pytest.mark.parametrize(
    "planner",
    [
        LATTICE,
        {"roadmap": {"samples": 60}},
        {"any-angle": {"step": 1.0}},
        {"weighted-sum": {"step": 1.0}},
        {"exact": {"on": {"lattice": {"step": 1.0, "anchor": "world"}}, "eps": 0.1}},
        {"lattice": {"step": 1.0, "time_limit": 60, "max_memory": 2_000_000_000}},
    ],
    ids=lambda planner: next(iter(planner)),
)
def test_each_graph_and_search_chooses_among_the_speeds(planner: PlannerSpec) -> None:
    asked = problem()
    front = asked.solve(planner)
    assert verify(asked, front) == []
    assert speeds_of(front) == set(SPEEDS)
    assert "at speeds of 0.5, 1 and 1.5 m/s" in front.certificate
    assert "NOT VALID" not in front.certificate


def test_turns_have_one_of_several_rates_in_files_tables_and_tours(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = """\
world: {polygons: {extent: [[0, 0], [8, 0], [8, 6], [0, 6]]}}
model: {differential_drive: {radius: 0.3, turn_rates: %s}}
start: [1, 1, 0]
goal: [7, 5, any]
criteria: [duration, peak_optic_flow]
tour: {stops: [{at: [6, 1], within: 0.8, dwell: 3}]}
planner: {lattice: {step: 1.0}}
"""
    (tmp_path / "room.yaml").write_text(text % "[0.4, 1.5]")
    asked = load_scenario(tmp_path / "room.yaml").problem
    front = asked.solve({"lattice": {"step": 1.0}})
    assert verify(asked, front) == []
    assert "each turn at one of 2 rates (turn_0.4, turn)" in front.certificate
    print_front(asked, front)
    assert "1 turn_0.4" in capsys.readouterr().out
    slow = next(each for each in front.trajectories if "turn" not in each.kinds)
    turned = np.abs(np.diff(slow.states.yaw))[[kind == "turn_0.4" for kind in slow.kinds]]
    lasts = slow.execution().durations[[kind == "spin_0.4" for kind in slow.execution().kinds]]
    assert lasts == pytest.approx(turned / 0.4 + 0.4 / 3.0)  # a trapezoid at 3 rad/s²
    assert np.abs(slow.model.wheels(slow.execution(), np.arange(0, slow.duration, 0.01)).left_speed).max() <= 1.0
    front.save(tmp_path / "front.json")
    assert [t.kinds for t in Front.load(tmp_path / "front.json").trajectories] == [t.kinds for t in front.trajectories]
    (tmp_path / "room.yaml").write_text(text % "[1.5, 0.4]")
    with pytest.raises(hpop.errors.HpopError, match=r"(?s)turn_rates must be .* rising turn rates in rad/s.*sort them"):
        load_scenario(tmp_path / "room.yaml")
    assert hpop.DifferentialDrive(turn_rates=[0.7]) == hpop.DifferentialDrive(turn_rate=0.7)
    with pytest.raises(ModelError, match=r"turn_rate is the largest of turn_rates, 1.5, got 2.0; leave it out"):
        hpop.DifferentialDrive(turn_rate=2.0, turn_rates=(0.4, 1.5))


@pytest.mark.proof
@pytest.mark.parametrize("head", [False, True])
def test_the_fastest_profile_makes_slow_turns_at_the_largest_rate(head: bool) -> None:
    fixed = PanTilt(base=TURNING, pan=(0.0, 0.0), tilt=(0.0, 0.0))  # it cannot turn its view back
    robot, more = (fixed, (0.0, 0.0)) if head else (TURNING, ())
    asked = problem(robot, ("duration", "peak_optic_flow"), start=(1, 1, 0, *more), goal=(6.5, 5, None, *more))
    slow = next(each for each in asked.solve(LATTICE).trajectories if "turn_0.4" in each.kinds)
    turned = np.abs(np.diff(slow.states.yaw))[[kind == "turn_0.4" for kind in slow.kinds]]
    saved = (turned / 0.4 + 0.4 / 3.0 - turned / 1.5 - 1.5 / 3.0).sum()  # trapezoids at 3 rad/s²
    (fastest,) = hpop.retime(asked, slow, points=1).trajectories
    assert fastest.duration <= slow.execution().duration - saved + 0.01


def test_max_turns_and_a_checkpoint_leave_the_front_as_it_is(tmp_path: Path) -> None:
    asked = problem(criteria=("duration", "turns", "felt_acceleration"))
    front = asked.solve(LATTICE)
    most = int(np.median(front.costs[:, 1]))
    few = asked.solve({"lattice": {"step": 0.5, "max_turns": most}})
    wanted = front.costs[front.costs[:, 1] <= most]
    assert np.array_equal(np.unique(few.costs, axis=0), np.unique(wanted, axis=0))
    saved = {"lattice": {"step": 0.5, "checkpoint": str(tmp_path / "search")}}
    for _ in range(2):
        assert np.array_equal(asked.solve(saved).costs, front.costs)


@criterion("test_jolt", group="C", unit="1", aggregate="sum")
@dataclass(frozen=True)
class Jolt:
    """Own criterion: the square of a change of speed, so that two small changes cost less than a large one."""

    def cost(self, m: Motions) -> Column:
        return (m.end.speed - m.start.speed) ** 2 if m.law.varies == {"speed"} else 0.0 * m.duration


@criterion("test_wear", group="R", unit="1", aggregate="sum")
@dataclass(frozen=True)
class Wear:
    """Own criterion: the square of the speed over time, read from the states of a move."""

    def cost(self, m: Motions) -> Column:
        return m.start.speed**2 * m.duration if "speed" in m.law.extra else 0.0 * m.duration


def test_changes_by_way_of_slower_speeds_stay_where_they_cost_less_than_one_change() -> None:
    asked = problem(criteria=("duration", "test_jolt"), goal=(6, 5, 0), start=(1, 5, 0))
    front = asked.solve({"lattice": {"step": 1.0}})
    assert verify(asked, front) == []
    assert "NOT VALID" not in front.certificate
    # To a class in steps of 0.5 m/s, then to rest at once or in such steps: both last equally long.
    assert front.costs.tolist() == pytest.approx(np.array([[5 / 1.5 + 1.5, 1.5], [6.0, 1.0], [10.5, 0.5]]))


def test_a_criterion_may_read_the_speed_of_moves() -> None:
    asked = problem(criteria=("duration", "test_wear"), goal=(6, 5, 0), start=(1, 5, 0))
    front = asked.solve({"lattice": {"step": 1.0}})
    assert verify(asked, front) == []
    assert "NOT VALID" not in front.certificate
    assert speeds_of(front) == set(SPEEDS)


@pytest.mark.parametrize("planner", [{"lattice": {"step": 1.0, "anchor": "world"}}, {"roadmap": {"samples": 60}}])
@pytest.mark.parametrize("start", [(1, 1, 0), (1.2, 1.1, 0.3)])
def test_plans_use_the_fastest_speed_if_no_cost_depends_on_it(planner: PlannerSpec, start: tuple[float, ...]) -> None:
    front = problem(criteria=("length", "turns"), start=start).solve(planner)
    assert len(front)
    assert speeds_of(front) == {SPEEDS[-1]}


def test_a_mean_over_time_is_that_of_the_whole_plan_with_its_changes() -> None:
    asked = problem(criteria=("obstruction", "turns", "length"))
    front = asked.solve({"lattice": {"step": 1.0, "max_detour": 1.1}})
    assert front.certificate.startswith("lattice: exact under duration")
    assert verify(asked, front) == []


def test_the_table_of_a_front_shows_the_speeds_of_each_plan(capsys: pytest.CaptureFixture[str]) -> None:
    asked = problem(criteria=("duration", "felt_acceleration"))
    print_front(asked, asked.solve({"lattice": {"step": 1.0}}))
    printed = capsys.readouterr().out
    assert re.search(r"speeds\b", printed)
    assert re.search(r"\b0.5 1(\.5)?\b", printed)
    profile = trajectory(*[(1 + i, 0, i % 5 / 10) for i in range(6)], kinds=("run",) * 5)
    assert driven_speeds(profile) == "up to 0.4"


def test_a_tour_stands_at_its_stops_and_keeps_speeds_between_them() -> None:
    stops = [{"at": (6, 1), "within": 0.8, "dwell": 3, "name": "east"}, {"at": (1.3, 5.2), "within": 0.1, "dwell": 1}]
    tour = hpop.Tour([*stops, {"at": (4, 5), "within": 1}], "any")
    asked = problem(criteria=("duration", "felt_acceleration"), tour=tour)
    front = asked.solve({"lattice": {"step": 1.0}})
    assert verify(asked, front) == []
    assert speeds_of(front) > {0.5, 1.5}
    for trajectory in front.trajectories:
        holds = [i for i, kind in enumerate(trajectory.kinds) if kind == "hold"]
        assert len(holds) == 2
        assert all(trajectory.states.speed[i] == trajectory.states.speed[i + 1] == 0.0 for i in holds)


@dataclass(frozen=True)
class Cart(PlanarModel):
    """A base of its own with two speeds and two turn rates, as docs/own_robot_reference.md describes one."""

    name: ClassVar[str] = "cart"
    paces = ({"turn": "turn_0.3"}, {"turn": "turn"})
    executed: ClassVar[Mapping[str, str]] = {"move": "run", "turn": "spin", "turn_0.3": "spin_0.3"}
    speed_classes: tuple[float, ...] = (0.4, 0.8)

    @property
    def space(self) -> StateSpace:
        return plane_space(0.5)

    @property
    def laws(self) -> Mapping[str, Law]:
        slow = {"turn_0.3": Turn(0.3, 2.0, 0.0, "turn_0.3"), "spin_0.3": Spin(0.3, 2.0, "spin_0.3")}
        turns = {"turn": Turn(1.0, 2.0, loss=0.0), "spin": Spin(1.0, 2.0), **slow}
        return {**speed_laws(self.speed_classes, acceleration=0.5), **turns}

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part(((0.0, 0.0),), 0.3, 0.0, 1.0),)

    @property
    def mounts(self) -> Mapping[str, Mount]:
        return {"base": Mount(), "camera": Mount(height=1.2)}


class OneSpeedCart(Cart):
    """A base that lists speeds but lacks their laws."""

    @property
    def laws(self) -> Mapping[str, Law]:
        return {kind: law for kind, law in super().laws.items() if kind != "speed_change"}


@pytest.mark.parametrize(
    ("cart", "message"),
    [(Cart((0.8, 0.4)), "rising speeds.*sort them"), (OneSpeedCart(), "its laws must include 'speed_change'")],
)
def test_a_robot_whose_speeds_do_not_fit_its_laws_is_refused(cart: Cart, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        problem(cart, ("duration", "length")).solve(LATTICE)


@pytest.mark.parametrize(
    "base", [ROBOT, hpop.DifferentialDrive(radius=0.3, speeds=(0.4, 1.2), camera_offset=(0.1, 0)), Cart()]
)
def test_a_head_on_a_base_with_speeds_keeps_them(base: PlanarModel) -> None:
    robot = PanTilt(base=base, pan=(-np.pi / 2, np.pi / 2), tilt=(0.0, 0.0))
    asked = problem(
        robot, ("duration", "felt_acceleration", "rotation"), goal=(6.5, 3.0, 0.0, 0.0, 0.0), start=(1, 1, 0, 0, 0)
    )
    front = asked.solve({"lattice": {"step": 1.0}})
    assert verify(asked, front) == []
    assert len(speeds_of(front)) > 0
    assert ("turn_0.3" in front.certificate) == bool(base.paces)
    assert speeds_of(front) <= set(base.speed_classes)
    assert all(each.execution().duration <= each.duration + 1e-9 for each in front.trajectories)
    assert robot.speed_classes == base.speed_classes


def test_fronts_and_descriptions_are_read_as_they_were_saved(tmp_path: Path) -> None:
    asked = problem()
    front = asked.solve({"lattice": {"step": 1.0}})
    front.save(tmp_path / "front.json")
    again = Front.load(tmp_path / "front.json")
    assert verify(asked, again) == []
    for one, other in zip(front.trajectories, again.trajectories, strict=True):
        assert one.kinds == other.kinds
        assert np.array_equal(one.states.speed, other.states.speed)
        assert Trajectory.from_description(ROBOT, one.describe()).kinds == one.kinds
    (parameters,) = ROBOT.describe().values()
    assert hpop.DifferentialDrive(**parameters) == ROBOT


def test_a_scenario_names_the_speeds(tmp_path: Path) -> None:
    text = """\
world: {polygons: {extent: [[0, 0], [8, 0], [8, 6], [0, 6]]}}
model: {differential_drive: {radius: 0.3, speeds: %s}}
start: [1, 1, 0]
goal: [7, 5, any]
criteria: [duration, felt_acceleration]
planner: {lattice: {step: 1.0}}
"""
    models = []
    for speeds in ("[0.5, 1.5]", "0.5", "[0.5]"):
        path = tmp_path / "room.yaml"
        path.write_text(text % speeds)
        scenario = load_scenario(path)
        models.append(scenario.problem.model)
    assert [model.speed_classes for model in models] == [(0.5, 1.5), (), ()]
    assert models[1] == models[2] == hpop.DifferentialDrive(radius=0.3, speed=0.5)
    (tmp_path / "room.yaml").write_text(text.replace("speeds: %s", "turn_rate: [0.5, 1.5]"))
    with pytest.raises(hpop.errors.HpopError, match=r"got \[0.5, 1.5\]; to list several, write turn_rates"):
        load_scenario(tmp_path / "room.yaml")


@pytest.mark.parametrize(
    ("speeds", "message"),
    [
        ([1.0, 0.5], "sort them"),
        ([0.5, 0.5], "give each once"),
        ([], "a list of up to 8 rising speeds"),
        ("fast", "got 'fast'"),
        ([0.5, -1], "speeds in m/s, each"),
        (list(range(1, 12)), "up to 8"),
        (np.array(0.5), r"got array\(0.5\)"),
        (np.ones((2, 2)), "speeds in m/s, each"),
    ],
)
def test_wrong_speeds_are_refused(speeds: Any, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        hpop.DifferentialDrive(speeds=speeds)


def test_a_speed_that_is_not_the_largest_is_refused() -> None:
    with pytest.raises(ModelError, match=r"speed is the largest of speeds, 1.5, got 0.7; leave it out"):
        hpop.DifferentialDrive(speed=0.7, speeds=SPEEDS)
    assert hpop.DifferentialDrive(speed=1.5, speeds=SPEEDS) == hpop.DifferentialDrive(speeds=SPEEDS)


@pytest.mark.parametrize("planner", ["rrt", "smoothing", "epsilon-constraint"])
def test_planners_for_one_speed_say_which_ones_choose(planner: str) -> None:
    with pytest.raises(
        UnsupportedModel, match=r"the robot has the speeds 0.5, 1, 1.5 m/s; give the model one speed.*lattice"
    ):
        problem(criteria=("duration", "length")).solve(planner)
    with pytest.raises(UnsupportedModel, match=r"1 m/s and turn_0.4, turn; give the model one speed and one turn rate"):
        problem(TURNING, criteria=("duration", "length")).solve(planner)


def trajectory(*rows: tuple[float, float, float], kinds: tuple[str, ...]) -> Trajectory:
    """Return a trajectory along the x axis through rows of x, yaw and speed."""
    x, yaw, speed = np.array(rows, float).T
    return Trajectory(ROBOT, States(x=x, y=np.ones(x.size), yaw=yaw, speed=speed), kinds)


def test_an_execution_ramps_behind_a_change_up_and_before_a_change_down() -> None:
    changes, move = "speed_change", "move"
    plan = trajectory(
        (1, 0, 0),
        (1, 0, 0.5),
        (2, 0, 0.5),
        (2, 0, 1.0),
        (4, 0, 1.0),
        (4, 0, 0.5),
        (5, 0, 0.5),
        (5, 0, 0),
        kinds=(changes, move, changes, move, changes, move, changes),
    )
    run = plan.execution()
    # By v = at and s = v²/2a: 0.125 m from rest to 0.5 m/s, 0.375 m from 0.5 to 1 m/s, and back.
    assert run.states.x.tolist() == pytest.approx([1, 1.125, 2, 2.375, 3.625, 4, 4.875, 5])
    assert run.states.speed.tolist() == pytest.approx([0, 0.5, 0.5, 1, 1, 0.5, 0.5, 0])
    assert run.duration == pytest.approx(0.5 + 1.75 + 0.5 + 1.25 + 0.5 + 1.75 + 0.5)
    assert plan.duration == pytest.approx(2 + 2 + 2 + 1.0)
    assert list(ROBOT.faults(run)) == list(ROBOT.faults(plan)) == []


@pytest.mark.parametrize(
    ("rows", "kinds", "message"),
    [
        ([(1, 0, 0.7), (2, 0, 0.7)], ("move",), "drives at 0.7 m/s in motion 0, which is none of its speeds"),
        ([(1, 0, 0.5), (2, 0, 0.5)], ("move",), "begins at 0.5 m/s, not at rest"),
        ([(1, 0, 0), (1, 0, 0.5), (2, 0, 0.5)], ("speed_change", "move"), "ends at 0.5 m/s, not at rest"),
        ([(1, 0, 0.5), (1, 0, 1.5), (2, 0, 1.5)], ("speed_change", "move"), "changes from 0.5 to 1.5 m/s in motion 0"),
        ([(1, 0, 0), (1, 0, 1), (2, 0, 0.5)], ("speed_change", "move"), "jumps from 1 to 0.5 m/s in motion 1, a move"),
        ([(1, 0, 1), (2, 0, 1), (2, 1, 1)], ("move", "turn"), "is at 1 m/s in motion 1, a turn, which is made at rest"),
        ([(1, 0, 0), (1.1, 0, 1)], ("run",), "speeds up or brakes harder than 1 m/s² in motion 0"),
        ([(1, 0, 1), (1.9, 0, 1.9)], ("run",), "drives faster than 1.5 m/s in motion 0"),
    ],
)
def test_impossible_speeds_are_faults(rows: Any, kinds: tuple[str, ...], message: str) -> None:
    assert any(fault.startswith(message) for fault in ROBOT.faults(trajectory(*rows, kinds=kinds)))


@pytest.mark.parametrize(
    "robot",
    [ROBOT, *(pytest.param(r, marks=pytest.mark.proof) for r in (PanTilt(base=ROBOT), TURNING, PanTilt(TURNING)))],
)
def test_robots_with_speeds_pass_the_checks_of_models(robot: PlanarModel) -> None:
    check_model(robot)


def test_trajectories_through_poses_take_the_fastest_speed_from_rest_to_rest() -> None:
    plan = Trajectory.from_poses(ROBOT, [(1, 1, 0), (3, 1, 0), (3, 4, np.pi / 2)])
    assert plan.kinds == ("speed_change", "move", "speed_change", "turn", "speed_change", "move", "speed_change")
    assert plan.states.speed.tolist() == [0.0, 1.5, 1.5, 0.0, 0.0, 1.5, 1.5, 0.0]
    assert list(ROBOT.faults(plan)) == []
