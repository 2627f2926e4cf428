"""Straight approaches to goals: plans against pinocchio's frames, the proof against brute force, and refusals."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import ModelError, QueryError
from hpop.goals import AnyOf, CameraAt, ToolAt
from hpop.goals.approach import Approach
from hpop.motions import States
from hpop.problems.verify import verify
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Box, Solid, World, pose_at
from tests.models.serial_arm.arms import HERE, arm6

TABLE = Solid(Box((1.0, 1.4, 0.04)), pose_at((0.2, 0, -0.02)), "table")
BOARD = Solid(Box((0.3, 1.0, 0.02)), pose_at((0.65, 0, 0.36)), "board")
SHELF = World.from_solids([TABLE, BOARD])
ARM = arm6()
TIPS = {"distance": 0.12, "axis": (0, 0, 1)}  # along the fingers
DOWN = {"distance": 0.1, "direction": (0, 0, -3), "tolerance": 0.001, "angle": "1 deg"}
ABOVE = (0.55, 0.25, 0.45)


def asked(goal, arm=ARM, world=SHELF, start="home", **more):
    return hpop.Problem(world, arm, start, goal, ["duration", "rotation"], **more)


def frames(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, 3) and rotations (N, 3, 3) of the tool by pinocchio at joint values (N, 6)."""
    pin = pytest.importorskip("pinocchio")
    model = pin.buildModelFromUrdf(str(HERE / "arm6.urdf"))
    data, tool = model.createData(), model.getFrameId("tool")
    places, turned = [], []
    for row in rows:
        q = pin.neutral(model)
        for name, value in zip(ARM.joints, row, strict=True):
            q[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, data, q)
        places.append(data.oMf[tool].translation.copy())
        turned.append(data.oMf[tool].rotation.copy())
    return np.array(places), np.array(turned)


def last_metres(trajectory, distance: float, way) -> tuple[float, float, float]:
    """Largest distance from the line, m, largest angle, rad, and length, m, of the last part of a trajectory.

    The last part begins where the tool is last ``distance`` m or more behind its end.
    """
    states = trajectory.at(np.linspace(0, trajectory.duration, 2000))
    places, turned = frames(np.stack([getattr(states, name) for name in ARM.joints], axis=1))
    along = way(turned[-1])
    behind = (places[-1] - places) @ along
    begin = int(np.flatnonzero(behind >= distance - 1e-4)[-1])
    off = places[begin:] - places[-1] + behind[begin:, None] * along
    cosine = (np.einsum("nij,ij->n", turned[begin:], turned[-1]) - 1) / 2
    return (
        float(np.linalg.norm(off, axis=1).max()),
        float(np.arccos(np.clip(cosine, -1, 1)).max()),
        float(behind[begin]),
    )


@pytest.mark.cases("axis")
@pytest.mark.parametrize(
    ("approach", "way", "tolerance", "angle"),
    [
        (TIPS, lambda turned: turned[:, 2], 0.002, radians(2)),
        (DOWN, lambda turned: np.array([0, 0, -1.0]), 0.001, radians(1)),
    ],
    ids=["axis", "direction"],
)
def test_the_tool_moves_along_the_line_by_the_frames_of_pinocchio(approach, way, tolerance, angle):
    problem = asked(ToolAt(ABOVE, approach=approach))
    front = problem.solve("roadmap", samples=60)
    assert len(front)
    assert verify(problem, front) == []
    assert f"reaches its goals straight over the last {approach['distance']:g} m along" in front.certificate
    for trajectory in front.trajectories:
        off, turned, length = last_metres(trajectory, approach["distance"], way)
        assert off <= tolerance
        assert turned <= angle
        assert length == pytest.approx(approach["distance"], abs=2e-3)
    again = hpop.Problem.from_description(front.problem)
    assert again.goal == problem.goal


def test_a_path_that_comes_from_the_side_is_found_out():
    straight = asked(ToolAt(ABOVE, approach=DOWN))
    front = asked(ToolAt(ABOVE)).solve("roadmap", samples=60)
    faults = verify(straight, front)
    assert [fault for fault in faults if "does not end with its straight approach" in fault]
    lines = [last_metres(t, 0.1, lambda turned: np.array([0, 0, -1.0]))[0] for t in front.trajectories]
    assert min(lines) > 0.001


def test_what_is_proved_stays_near_the_line_and_what_is_refused_does_not():
    """The motions skip states on the line, or pass beside them; 400 samples of each are the oracle."""
    goal = ToolAt(ABOVE, approach=TIPS)
    ends = goal.states(asked(goal), np.random.default_rng(1), 12)
    rough = Approach("tool", 0.12, (0.0, 0.0, 1.0), None, 0.0005, radians(0.5))
    rows = [each for each in rough.lines(ARM, ARM.space, SHELF, ends).rows if each is not None]
    rng, kept = np.random.default_rng(2), []
    for row in rows:
        for stride in (1, 2, len(row) - 1):
            knots = row[np.unique([*range(len(row) - 1, -1, -stride), 0])]
            knots[1:-1] += rng.choice([0, 1e-4, 1e-3]) * rng.standard_normal(knots[1:-1].shape)
            trajectory = Trajectory.through(ARM, States(**dict(zip(ARM.joints, knots.T, strict=True))))
            off, turned, _ = last_metres(trajectory, 0.1195, lambda turned: turned[:, 2])
            proved = rough.begin(trajectory, SHELF) is not None
            assert not proved or (off <= 0.0005 and turned <= radians(0.5))
            assert proved or off >= 0.9 * 0.0005 or turned >= 0.9 * radians(0.5)
            kept.append(proved)
    assert 3 < sum(kept) < len(kept) - 3


@pytest.mark.proof
def test_reaches_at_other_speeds_approach_as_well():
    arm = arm6(velocity_scaling=[0.3, 1.0])
    problem = hpop.Problem(SHELF, arm, "home", ToolAt(ABOVE, approach=DOWN), ["duration", "felt_acceleration"])
    front = problem.solve("roadmap", samples=20)
    assert {"reach", "reach_0.3"} <= {kind for trajectory in front.trajectories for kind in trajectory.kinds}
    assert verify(problem, front) == []


@pytest.mark.proof
def test_splines_leave_the_approach_as_it_is():
    problem = asked(ToolAt(ABOVE, approach=DOWN))
    front = problem.solve("spline", warm_start={"roadmap": {"samples": 40}})
    splines = [trajectory for trajectory in front.trajectories if "spline" in trajectory.kinds]
    assert splines
    assert verify(problem, front) == []
    for trajectory in splines:
        assert last_metres(trajectory, 0.1, lambda turned: np.array([0, 0, -1.0]))[0] <= 0.001
        table = trajectory.table(step=0.005, body="joints")
        speeds = np.diff([table[name] for name in ARM.joints], axis=1) / 0.005
        assert np.abs(speeds).max() < 5  # no jump where the spline ends


@pytest.mark.proof
def test_a_base_stands_while_its_arm_approaches():
    robot = hpop.MobileArm(arm6(base=(0, 0, 0.3, 0, 0, 0)))
    world = World.from_polygons([], extent=shapely.box(-3, -3, 3, 3))
    goal = ToolAt((1.0, 0.5, 0.9), approach={"distance": 0.1, "direction": (0, 0, -1)})
    folded = robot.arm.space.state("home")
    home = [float(getattr(folded, name)[0]) for name in robot.joints]
    problem = hpop.Problem(world, robot, (-1, 0, 0, *home), goal, ["duration"])
    front = problem.solve("roadmap", samples=80, trees=3)
    assert verify(problem, front) == []
    (trajectory,) = front.trajectories[:1]
    tool = [robot.pose("tool", trajectory.states.take([i])) for i in range(len(trajectory) + 1)]
    heights = [float(each.z[0]) for each in tool]
    begin = goal.straight.begin(trajectory, world)
    assert heights[begin] == pytest.approx(heights[-1] + 0.1, abs=1e-6)
    assert np.ptp(trajectory.states.x[begin:]) == 0
    profiles = hpop.retime(problem, trajectory, points=1)
    assert verify(hpop.Problem.from_description(profiles.problem), profiles) == []


@pytest.mark.proof
@pytest.mark.cases("limited jerk")
@pytest.mark.parametrize("jerk", [None, 40.0], ids=["any jerk", "limited jerk"])
def test_a_speed_profile_and_a_pause_leave_the_approach_straight(jerk):
    problem = asked(ToolAt(ABOVE, approach=DOWN))
    path = problem.solve("roadmap", samples=40).trajectories[0]
    front = hpop.retime(problem, path, points=2, jerk=jerk)
    assert verify(hpop.Problem.from_description(front.problem), front) == []
    for trajectory in front.trajectories:
        assert last_metres(trajectory, 0.1, lambda turned: np.array([0, 0, -1.0]))[0] <= 0.001
    paused = path.with_hold(at=len(path) - 1, seconds=2.0)
    assert problem.goal.straight.begin(paused, SHELF) == problem.goal.straight.begin(path, SHELF)


def test_only_the_alternative_that_asks_for_it_is_approached():
    plain = ToolAt((0.45, -0.3, 0.6))
    problem = asked(AnyOf(ToolAt(ABOVE, approach=DOWN), plain))
    front = problem.solve("roadmap", samples=30)
    assert verify(problem, front) == []
    ends = front.trajectories[0].states.take([-1])
    assert plain.reached(ARM, ends)[0] or len(front.trajectories[0]) >= 2


@pytest.mark.parametrize(
    ("place", "approach", "reason"),
    [
        pytest.param(  # from below
            *((0.65, 0.1, 0.45), {"distance": 0.2, "direction": (0, 0, 1)}, r"\d+ the approach is blocked"),
            marks=pytest.mark.proof,
        ),
        ((0.62, 0.0, 0.75), {"distance": 0.6, "direction": (-1, 0, 0)}, r"\d+ have no states on the line"),
    ],
)
def test_what_cannot_be_approached_is_refused_with_reasons(place, approach, reason):
    with pytest.raises(QueryError, match=rf"cannot be approached like this: of its \d+ free states.*{reason}"):
        asked(ToolAt(place, approach=approach)).solve("roadmap", samples=10)


@pytest.mark.parametrize(
    ("approach", "said"),
    [
        (0.1, "approach must be a mapping such as"),
        ({"axis": (1, 0, 0)}, "approach must be a mapping such as"),
        ({"distance": 0.1, "way": (1, 0, 0)}, "approach must be a mapping such as"),
        ({"distance": 0}, "distance of approach must be"),
        ({"distance": -0.1}, "distance of approach must be"),
        ({"distance": float("nan")}, "distance of approach must be"),
        ({"distance": 0.1, "axis": (0, 0, 0)}, "axis of approach must be .* any length but 0"),
        ({"distance": 0.1, "direction": (0, 1)}, "direction of approach must be"),
        ({"distance": 0.1, "axis": (1, 0, 0), "direction": (0, 0, 1)}, "got both; leave one out"),
        ({"distance": 0.1, "tolerance": 0.2}, "tolerance of approach must be less than its distance"),
        ({"distance": 0.1, "angle": 0}, "angle of approach must be"),
        ({"distance": 0.1, "angle": 30}, "angle of approach"),
    ],
)
def test_bad_approaches_are_refused(approach, said):
    for goal in (ToolAt, CameraAt):
        with pytest.raises(QueryError, match=said):
            goal((0.5, 0, 0.5), approach=approach)


def test_stops_and_tours_have_no_approach():
    goal = ToolAt(ABOVE, approach=DOWN)
    with pytest.raises(QueryError, match="stop 'one' cannot have an approach"):
        asked("ready", tour={"stops": [{"name": "one", "goal": goal}]})
    with pytest.raises(QueryError, match="the goal of a tour cannot have an approach"):
        asked(goal, tour={"stops": [{"name": "one", "goal": ToolAt((0.4, 0.3, 0.6))}]}).solve("roadmap", samples=10)
    head = hpop.PanTilt(base=hpop.DifferentialDrive(radius=0.2, camera_height=1.2))
    world = World.from_polygons([], extent=shapely.box(0, 0, 4, 4))
    look = CameraAt((2, 2, 1.2), approach={"distance": 0.3})
    with pytest.raises(QueryError, match="pan_tilt cannot approach a goal along a line: only an arm can"):
        hpop.Problem(world, head, (1, 1, 0, 0, 0), look, ["duration"]).solve("roadmap", samples=10)
    with pytest.raises((QueryError, ModelError), match="joints"):
        hpop.Problem(
            World.from_polygons([], extent=shapely.box(0, 0, 4, 4)),
            hpop.DifferentialDrive(radius=0.2, camera_height=1.2),
            (1, 1, 0),
            CameraAt((2, 2, 1.2), approach={"distance": 0.3}),
            ["duration"],
        )
