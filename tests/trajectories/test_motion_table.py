"""Trajectories as a table of what they share: the same trajectories, the same costs, and nothing else is read."""

from __future__ import annotations

import json
import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import hpop
from hpop.criteria.base import make_criterion
from hpop.criteria.costs import trajectory_costs
from hpop.frontier import FrontFileError
from hpop.models.driven import driven
from hpop.motions import States
from hpop.trajectories.motion_table import MotionTable
from hpop.trajectories.trajectory import Trajectory

ROBOT = hpop.DifferentialDrive(radius=0.3, camera_height=1.2)
WORLD = hpop.World.from_polygons([shapely.box(2, 2, 3, 3)], extent=shapely.box(-50, -50, 50, 50))
PROBLEM = hpop.Problem(WORLD, ROBOT, (0, 0, 0), (4, 0, None), ["length"])
CRITERIA = ["exposure", "turns", "length", "obstruction", "clearance", "energy", "smoothness"]

numbers = st.integers(-90, 90).map(lambda tenths: tenths / 10) | st.just(-0.0)
poses = st.tuples(numbers, numbers, st.sampled_from([-math.pi, -0.0, 0.0, 0.1 + 0.2, math.pi / 2]))
controls = st.tuples(st.floats(0.1, 1), st.floats(-1, 1), st.floats(0.1, 2))
polylines = st.lists(poses, min_size=1, max_size=6).map(lambda ps: Trajectory.from_poses(ROBOT, ps))
drives = st.builds(lambda pose, cs: driven(ROBOT, pose, cs), poses, st.lists(controls, min_size=1, max_size=4))


def mixed(drive: Trajectory, end: tuple[float, float, float]) -> Trajectory:
    """Return a drive, then a turn and a move: all states have the columns of the drive."""
    s = drive.states
    after = Trajectory.from_poses(ROBOT, [(float(s.x[-1]), float(s.y[-1]), float(s.yaw[-1])), end])
    columns = {
        name: np.concatenate([getattr(s, name), getattr(after.states, name, np.zeros(len(after) + 1))[1:]])
        for name in s.names
    }
    return Trajectory(ROBOT, States(**columns), drive.kinds + after.kinds)


trajectories = st.lists(polylines | drives | st.builds(mixed, drives, poses), min_size=1, max_size=6)


def bits(trajectory: Trajectory) -> tuple[object, ...]:
    s = trajectory.states
    return trajectory.kinds, s.names, [getattr(s, name).tobytes() for name in s.names]


def front_of(several: list[Trajectory]) -> hpop.Front:
    n = len(several)
    return hpop.Front.of(
        [[i, n - i] for i in range(n)], several, names=["a", "b"], units=["1", "1"], quanta=[1.0, 1.0],
        status="complete", certificate="made by hand", problem=PROBLEM.describe(),
    )  # fmt: skip


@given(trajectories)
@settings(max_examples=settings.default.max_examples // 2)
def test_trajectories_come_back_from_a_file_bit_for_bit(tmp_path_factory, several):
    path = tmp_path_factory.mktemp("fronts") / "front.json"
    front_of(several).save(path)
    again = hpop.Front.load(path).trajectories
    assert [bits(t) for t in again] == [bits(t) for t in several]
    assert all(not getattr(t.states, name).flags.writeable for t in again for name in t.states.names)


@given(trajectories)
@settings(max_examples=settings.default.max_examples // 5)
def test_shared_motions_cost_what_each_alone_does(several):
    criteria = [make_criterion(name) for name in CRITERIA]
    alone = [trajectory_costs(criteria, [t], WORLD)[0] for t in several]
    np.testing.assert_allclose(trajectory_costs(criteria, several * 2, WORLD), alone * 2, rtol=1e-12, atol=1e-12)


def test_what_trajectories_share_is_kept_once():
    there = [(0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (4.0, 4.0, 0.0)]
    several = [Trajectory.from_poses(ROBOT, there), Trajectory.from_poses(ROBOT, [*there, (8.0, 4.0, 0.0)])]
    table = MotionTable.of(several)
    kinds = ["move", "turn", "move", "turn"]
    assert several[0].kinds == tuple(kinds)
    assert [table.laws[i] for i in table.law] == [*kinds, "move"]
    assert table.states.size == 6
    assert table.counts.tolist() == [4, 5]
    assert table.motions.tolist() == [0, 1, 2, 3, 0, 1, 2, 3, 4]
    assert all(table.end[a] == table.start[b] for a, b in pairwise(table.motions[4:]))
    assert table.having(np.arange(5) == 4).tolist() == [False, True]


def test_each_distinct_motion_is_evaluated_once():
    evaluated = []

    class Counting:
        name, group, unit, aggregate, requires, smooth, quantum = "counting", "O", "1", "sum", (), False, 1.0

        def cost(self, m):
            evaluated.append(len(m))
            return np.ones(len(m))

    walk = Trajectory.from_poses(ROBOT, [(0, 0, 0), (4, 0, 0), (4, 4, 0)])
    assert trajectory_costs([Counting()], [walk] * 100, WORLD).ravel().tolist() == [4.0] * 100
    assert sum(evaluated) == 4


def test_a_criterion_that_asks_when_a_motion_begins_is_told():
    class Late:
        name, group, unit, aggregate, requires, smooth, quantum = "late", "O", "s", "sum", (), False, 1.0

        def cost(self, m):
            return m.t0 + m.duration

    walk = Trajectory.from_poses(ROBOT, [(0, 0, 0), (4, 0, 0), (4, 4, 0)])
    (once,) = trajectory_costs([Late()], [walk], WORLD)
    assert trajectory_costs([Late()], [walk] * 3, WORLD).tolist() == [once.tolist()] * 3
    assert once == pytest.approx(walk.times[1:].sum())


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    """Return the document of a front whose trajectories turn, move, drive and stand still."""
    path = tmp_path_factory.mktemp("front") / "front.json"
    walk = Trajectory.from_poses(ROBOT, [(0, 0, 0), (4, 0, 0), (4, 4, 0)])
    front_of([walk, Trajectory.from_poses(ROBOT, [(0, 0, 0)]), driven(ROBOT, (0, 0, 0), [(1, 0, 1)])]).save(path)
    return path.read_text()


def put(place: str, value: object):
    """Return a function that changes one entry of the items, named by its keys."""

    def change(items):
        *keys, last = (int(key) if key.isdigit() else key for key in place.split("."))
        for key in keys:
            items = items[key]
        items[last] = value

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (put("motions.start.0", 99), "row numbers from 0 to 6 in motions.start"),
        (put("motions.end.0", -1), "row numbers from 0 to 6 in motions.end"),
        (put("motions.end.0", 10**400), "row numbers from 0 to 6 in motions.end"),
        (put("motions.kind.0", 3), "row numbers from 0 to 2 in motions.kind"),
        (put("motions.kind.0", True), "5 whole numbers in motions.kind"),
        (put("motions.kind.0", 1.0), "5 whole numbers in motions.kind"),
        (put("motions.kind", [0]), "in motions."),
        (put("trajectories.motions.0.0", 5), "row numbers from 0 to 4 in trajectories.motions"),
        (put("trajectories.motions.0.0", []), "whole numbers in trajectories.motions"),
        (put("trajectories.motions.0", 3), "one list of motions for each trajectory"),
        (put("trajectories.motions.0", [1, 0]), "trajectory 0 jumps"),
        (put("trajectories.start.0", 1), "trajectory 0 jumps"),
        (put("trajectories.start.1", None), "3 whole numbers in trajectories.start"),
        (put("trajectories.start", [0, 0]), "one start and one list of motions for each trajectory"),
        (put("states.x.0", None), "7 numbers in states.x, found 7 of type NoneType, float"),
        (put("states.x.0", 10**400), "the range of float64 in states.x"),
        (put("states.x.0", "1"), "7 numbers in states.x"),
        (put("states.y", [0.0]), "7 numbers in states.y, found 1"),
        (put("states.y.3", 9.0), "a turn must not change y"),
        (put("states.clock.5", None), "must be finite"),
        (put("states.arm", []), "unknown keys ['arm']"),
        (put("kinds.0", "fly"), "expected distinct motion laws"),
        (put("kinds.0", ["move"]), "expected distinct motion laws"),
        (put("kinds.0", "turn"), "expected distinct motion laws"),
        (lambda items: items.pop("kinds"), "missing keys ['kinds']"),
        (lambda items: items["states"].pop("yaw"), "missing keys ['yaw']"),
        (lambda items: items["states"].pop("clock"), "missing keys ['clock']"),
        (lambda items: items["motions"].pop("end"), "missing keys ['end']"),
        (lambda items: items["trajectories"].pop("start"), "missing keys ['start']"),
        (lambda items: [column.pop() for column in items["trajectories"].values()], "expected"),
    ],
)
def test_a_table_that_is_none_is_refused(tmp_path, document, change, message):
    changed = json.loads(document)
    change(changed["items"])
    path = tmp_path / "front.json"
    path.write_text(json.dumps(changed))
    with pytest.raises(FrontFileError) as caught:
        hpop.Front.load(path)
    assert str(path) in str(caught.value)
    assert message in str(caught.value)
    assert len(str(caught.value)) < 700


def test_a_front_of_anything_does_not_read_the_table_of_another(tmp_path, document):
    (tmp_path / "front.json").write_text(document)
    with pytest.raises(FrontFileError, match=r"only the class that saved the front can read.*hpop\.Front"):
        hpop.frontier.ItemFront.load(tmp_path / "front.json")


def test_a_file_is_a_small_part_of_what_its_trajectories_would_take(tmp_path):
    """A front of many trajectories over few states is written by its motions, not by its coordinates."""
    rng = np.random.default_rng(0)
    several = [
        Trajectory.from_poses(ROBOT, [(0.1 * i, 0.1 * int(y), 0.0) for i, y in enumerate(rng.integers(0, 3, 50))])
        for _ in range(200)
    ]
    front_of(several).save(tmp_path / "front.json")
    numbers = sum(3 * (len(t) + 1) for t in several)
    assert (tmp_path / "front.json").stat().st_size < 3 * numbers  # bytes; written out, a number takes some 18
