"""A robot that stands still for a while: how that is written, kept, executed and judged, of any robot."""

import json
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria.base import make_criterion
from hpop.criteria.costs import trajectory_costs
from hpop.errors import CriterionError, ModelError, OptionError
from hpop.models.driven import driven
from hpop.motions import HOLD, Hold, States, laws_of
from hpop.planners.programs.warm_starts import known_trajectories
from hpop.problems.front import Front
from hpop.problems.verify import collision_free, verify
from hpop.testing import check_criterion, check_model
from hpop.trajectories.motion_table import MotionTable
from hpop.trajectories.trajectory import Trajectory
from tests.jointed import Jointed
from tests.models.serial_arm.arms import arm6
from tests.view.robots import Lift

CAR = hpop.DifferentialDrive()
ROUND = [(1, 1, 0), (5, 1, 0), (5, 5, 0)]
GOES = Trajectory.from_poses(CAR, ROUND)
ROOM = hpop.World.from_polygons([shapely.box(7, 1, 8, 8)], extent=shapely.box(0, 0, 12, 9))


def through(model, *rows):
    return Trajectory.through(model, States(**dict(zip(model.space.names, np.array(rows, float).T, strict=True))))


ROBOTS = {
    "differential drive": GOES,
    "pan-tilt": through(hpop.PanTilt(), (1, 1, 0, 0, 0), (5, 1, 0, 1, 0.2)),
    "serial arm": through(arm6(), (0.1,) * 6, (0.4,) * 6, (0.2,) * 6),
    "mobile arm": through(hpop.MobileArm(arm6()), (1, 1, 0, *(0.1,) * 6), (3, 1, 0, *(0.4,) * 6)),
    "of no class of the house": through(Jointed(), (0, 0, 0), (1, 0.5, 0.5)),
    "of upright parts": through(Lift(), (1, 1, 0, 0), (2, 1, 1, 1)),
}


# Writing


def test_it_stands_there_for_so_long_and_goes_on_as_before():
    held = GOES.with_hold(at=1, seconds=2.5)
    assert held.kinds == ("move", "hold", "turn", "move", "turn")
    assert held.duration == pytest.approx(GOES.duration + 2.5)
    np.testing.assert_allclose(held.times, [0, 4, 6.5, *(GOES.times[2:] + 2.5)])
    inside = held.at(np.linspace(4.0, 6.5, 7))
    assert set(inside.x) == {5.0}
    assert set(inside.y) == {1.0}
    for later in np.linspace(4.0, GOES.duration, 9):
        there, before = held.at(later + 2.5), GOES.at(later)
        for name in CAR.space.names:
            np.testing.assert_allclose(getattr(there, name), getattr(before, name), atol=1e-9)


def test_holds_are_put_one_after_the_other():
    held = GOES.with_hold(at=4, seconds=1.0).with_hold(at=1, seconds=2.0).with_hold(at=0, seconds=3.0)
    assert held.kinds == ("hold", "move", "hold", "turn", "move", "turn", "hold")
    assert held.durations[[0, 2, 6]].tolist() == [3.0, 2.0, 1.0]


@pytest.mark.parametrize("goes", ROBOTS.values(), ids=ROBOTS)
def test_every_robot_can_stand_anywhere_on_its_way(goes):
    for at in range(len(goes) + 1):
        held = goes.with_hold(at=at, seconds=2.0)
        assert held.durations[at] == 2.0
        assert laws_of(held.model)["hold"] is HOLD
        first, _ = held.rates(held.times[at] + 1.0)
        assert all(getattr(first, name) == 0 for name in held.model.space.names)
        back = held.without_holds()
        assert back.kinds == goes.kinds
        for name in goes.states.names:
            np.testing.assert_array_equal(getattr(back.states, name), getattr(goes.states, name))


def test_without_holds_a_trajectory_is_itself():
    assert GOES.without_holds() is GOES
    assert GOES.states.names == ("x", "y", "yaw")


def test_curves_keep_their_times_before_and_after():
    curve = driven(CAR, (1, 1, 0), [(1, 0, 1), (0, 1, 1), (0, -1, 1), (-1, 0, 1)])
    held = curve.with_hold(at=4, seconds=2.0).with_hold(at=0, seconds=1.0)
    assert held.states.names == curve.states.names
    np.testing.assert_allclose(held.durations, [1, 1, 1, 1, 1, 2])
    np.testing.assert_allclose(held.without_holds().states.clock, curve.states.clock)
    assert held.without_holds().kinds == curve.kinds


def test_nobody_stops_at_once_on_a_curve():
    curve = driven(CAR, (1, 1, 0), [(1, 0, 1), (0, 0, 2), (-1, 0, 1)])
    with pytest.raises(ModelError, match="motion 0, a drive, meets motion 1, a hold, x still changes by 1 a second"):
        curve.with_hold(at=1, seconds=1.0)


@pytest.mark.parametrize("seconds", [0.0, -1.0, np.inf, np.nan, 3601.0, "3", None, True, 1 + 1j])
def test_a_hold_lasts_a_while(seconds):
    with pytest.raises(OptionError, match="seconds must be how long the robot stands, in s, from 1e-06 to 3,600"):
        GOES.with_hold(at=1, seconds=seconds)


def test_all_holds_of_a_trajectory_last_no_more_than_an_hour():
    long = GOES.with_hold(at=1, seconds=2000.0)
    with pytest.raises(ModelError, match="together must last at most 3,600 s, got 4,000 s"):
        long.with_hold(at=1, seconds=2000.0)


@pytest.mark.parametrize("at", [-1, 5, 1.5, "1", None, True])
def test_a_hold_is_at_a_state(at):
    with pytest.raises(OptionError, match="at must be the number of a state of the trajectory"):
        GOES.with_hold(at=at, seconds=1.0)


# Keeping


@pytest.mark.parametrize("goes", ROBOTS.values(), ids=ROBOTS)
def test_it_is_described_and_made_again_exactly(goes):
    held = goes.with_hold(at=1, seconds=0.7)
    again = Trajectory.from_description(goes.model, json.loads(json.dumps(held.describe())))
    assert again.kinds == held.kinds
    assert again.times.tolist() == held.times.tolist()
    assert "clock" not in goes.describe()["states"]


@pytest.mark.parametrize(
    ("clock", "text"),
    [
        ([0, 0, -2, -2, -2, -2], "motion 1, a hold, must last 0 to 3,600 s, got -2 s"),
        ([0, 0, 1e9, 1e9, 1e9, 1e9], "motion 1, a hold, must last 0 to 3,600 s, got 1e[+]09 s"),
        ([0, 0, np.nan, 0, 0, 0], "finite"),
        (None, "need states with the columns .*clock"),
    ],
)
def test_a_file_may_not_say_that_time_runs_backwards(clock, text):
    description = GOES.with_hold(at=1, seconds=2.0).describe()
    if clock is None:
        del description["states"]["clock"]
    else:
        description["states"]["clock"] = clock
    with pytest.raises(ModelError, match=text):
        Trajectory.from_description(CAR, description)


def test_who_stands_does_not_move_meanwhile():
    description = GOES.with_hold(at=1, seconds=2.0).describe()
    description["states"]["x"][2:] = [6.0, 6.0, 6.0, 6.0]
    with pytest.raises(ModelError, match="a hold must not change x, but motion 1, a hold, changes it by 1"):
        Trajectory.from_description(CAR, description)


def test_trajectories_with_holds_and_without_share_a_table():
    several = [GOES.with_hold(at=1, seconds=2.0), GOES, driven(CAR, (1, 1, 0), [(0, 2, 0.5), (0, -2, 0.5)])]
    several.append(several[2].with_hold(at=0, seconds=1.0))
    table = MotionTable.of(several)
    again = MotionTable.from_description(CAR, json.loads(json.dumps(table.describe()))).trajectories()
    for one, other in zip(several, again, strict=True):
        assert one.describe() == other.describe()


def test_a_table_with_a_gap_in_the_clock_of_a_hold_is_refused():
    description = json.loads(json.dumps(MotionTable.of([GOES.with_hold(at=1, seconds=2.0), GOES]).describe()))
    clock = description["states"]["clock"]
    clock[clock.index(2.0)] = None
    with pytest.raises(ModelError, match=r"a hold, must last .*got nan s"):
        MotionTable.from_description(CAR, description).trajectories()


def test_costs_together_are_those_of_each():
    criteria = [make_criterion(name) for name in ("duration", "exposure", "turns", "clearance", "energy")]
    several = [GOES.with_hold(at=1, seconds=2.0), GOES, GOES.with_hold(at=1, seconds=3.0).with_hold(at=4, seconds=1.0)]
    alone = np.concatenate([trajectory_costs(criteria, [one], ROOM) for one in several])
    np.testing.assert_allclose(trajectory_costs(criteria, several, ROOM), alone, rtol=1e-12)


def saved(tmp_path, trajectories):
    problem = hpop.Problem(ROOM, CAR, (1, 1, 0), (5, 5, 0), ["duration", "turns"])
    costs = trajectory_costs(problem.criteria, trajectories, ROOM)
    declared = {f"{field}s": [getattr(c, field) for c in problem.criteria] for field in ("name", "unit", "group")}
    declared |= {"quanta": [criterion.quantum for criterion in problem.criteria], "status": "complete"}
    front = Front.of(costs, trajectories, **declared, certificate="made by hand", problem=problem.describe())
    front.save(tmp_path / "front.json")
    return problem, Front.load(tmp_path / "front.json")


def test_a_front_with_a_hold_is_saved_loaded_and_verified(tmp_path):
    turned = Trajectory.from_poses(CAR, [(1, 1, 0), (1, 5, 0), (3, 6, 0), (5, 5, 0)])
    problem, front = saved(tmp_path, [GOES.with_hold(at=2, seconds=30.0), turned])
    assert any("hold" in trajectory.kinds for trajectory in front.trajectories)
    assert verify(problem, front) == []


# Judging


@pytest.mark.parametrize("goes", ROBOTS.values(), ids=ROBOTS)
def test_it_has_no_fault_that_its_way_has_not(goes):
    held = goes.with_hold(at=len(goes), seconds=1.0)
    faults = getattr(goes.model, "faults", lambda trajectory: ())
    assert list(faults(held)) == list(faults(goes))


def test_who_stands_is_free_where_the_state_is():
    problem = hpop.Problem(ROOM, CAR, (1, 1, 0), (5, 5, 0), ["duration"])
    stood = [
        Trajectory.from_poses(CAR, [at]).with_hold(at=0, seconds=5.0) for at in ((2, 2, 0), (7.5, 3, 0), (6.8, 3, 0))
    ]
    assert collision_free(problem, stood).tolist() == [True, False, False]


def test_an_arm_that_stands_beyond_a_limit_is_at_fault():
    model = arm6()
    beyond = through(model, (0.1,) * 6)
    far = States(**{name: np.full(1, 9.0) for name in model.space.names})
    stood = Trajectory(model, far, ()).with_hold(at=0, seconds=1.0)
    assert "beyond its limit" in next(iter(model.faults(stood)))
    assert model.doubtful(HOLD, *(stood.states.take([i]) for i in (0, 1))).tolist() == [True]
    assert list(model.faults(beyond.with_hold(at=0, seconds=1.0))) == []


# Executing


def test_what_is_executed_stands_as_long_and_where_it_is_planned():
    straight = Trajectory.from_poses(CAR, [(1, 1, 0), (3, 1, 0), (6, 1, 0)])
    assert straight.execution().kinds == ("run",)
    planned = straight.with_hold(at=1, seconds=2.0)
    done, passed = CAR.execution(planned)
    assert done.kinds == ("run", "hold", "run")
    np.testing.assert_allclose(done.durations, [3.0, 2.0, 4.0])  # metres at 1 m/s, and v/a each
    np.testing.assert_allclose(passed, [0.0, 3.0, 5.0, 9.0])
    assert done.states.clock.tolist() == planned.states.clock.tolist() == [0.0, 0.0, 2.0, 2.0]


@pytest.mark.parametrize("goes", ROBOTS.values(), ids=ROBOTS)
def test_every_robot_executes_holds(goes):
    if not hasattr(goes.model, "execution"):
        pytest.skip("this one executes nothing")
    done, passed = goes.model.execution(goes.with_hold(at=1, seconds=2.0))
    assert done.durations[list(done.kinds).index("hold")] == 2.0
    assert passed[2] - passed[1] == pytest.approx(2.0)


def test_a_trace_shows_what_standing_costs():
    problem = hpop.Problem(ROOM, CAR, (1, 1, 0), (5, 5, 0), ["duration", "exposure", "turns", "smoothness"])
    held = Trajectory.from_poses(CAR, [(1, 1, 0), (6, 1, 0), (5, 5, 0)]).with_hold(at=1, seconds=3.0)
    trace = problem.trace(held)
    np.testing.assert_allclose(trace.running[-1], trace.cost, rtol=1e-9)
    during = (trace.times[:-1] >= 5.0 - 1e-9) & (trace.times[1:] <= 8.0 + 1e-9)
    assert during.sum() > 10  # it is cut into pieces
    rate = ROOM.obstruction(CAR.pose("camera", held.states.take([1])), 2.0)
    assert rate > 0
    np.testing.assert_allclose(trace.rate[during, 1], rate[0], rtol=1e-6)


# Planning and checking


def test_planners_start_from_a_way_without_its_holds():
    problem = hpop.Problem(ROOM, CAR, (1, 1, 0), (5, 5, 0), ["duration"])
    given = [GOES.with_hold(at=1, seconds=2.0), GOES]
    with pytest.raises(StopIteration) as ended:  # given trajectories have no stages
        next(known_trajectories(SimpleNamespace(warm_start=given, time_limit=None), problem, None, None))
    known = ended.value.value
    assert [trajectory.kinds for trajectory in known.trajectories] == [GOES.kinds] * 2
    assert known.notes == (
        "1 of the warm starts pause on their way; the pauses were removed, as this planner plans none",
    )


@dataclass(frozen=True)
class Own(hpop.DifferentialDrive):
    @property
    def laws(self):
        return {**super().laws, "hold": Hold()}


@dataclass(frozen=True)
class Hasty(hpop.DifferentialDrive):
    """It executes what it plans, but does not wait."""

    def execution(self, trajectory):
        return super().execution(trajectory.without_holds())


@pytest.mark.parametrize(
    ("robot", "text"),
    [(Own(), "choose another name"), (Hasty(), "times of passing .* planned states must not decrease")],
)
def test_the_check_of_models_looks_at_holds(robot, text):
    with pytest.raises(ModelError, match=text):
        check_model(robot)


@dataclass(frozen=True)
class Restless:
    """It charges each hold as if all lasted equally long."""

    name, group, unit, aggregate, requires, smooth, quantum = "restless", "O", "s", "sum", (), False, 1e-6

    def cost(self, m):
        return 1.0 + 0.0 * m.duration if m.kind == "hold" else m.duration


def test_the_check_of_criteria_looks_at_holds():
    with pytest.raises(
        CriterionError, match="fails 1 check:\n  costs the two halves of a move or hold as much as the whole"
    ):
        check_criterion(Restless())


def test_a_table_shows_it_standing():
    table = GOES.with_hold(at=1, seconds=2.0).table(0.5, executed=False)
    standing = (table["t"] > 4.0) & (table["t"] < 6.0)
    assert standing.sum() == 3
    assert set(table["vx"][standing]) == {0.0}
    assert set(table["x"][standing]) == {5.0}
