"""A prompt shows any value in a few lines that say what it is."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import hpop
from hpop.motions import Motions, States
from hpop.planners import Candidates
from hpop.runtime.limits import Status
from hpop.scenario import load_scenario
from hpop.search import Graph, pareto_paths
from hpop.trajectories.history import History
from hpop.trajectories.motion_table import MotionTable
from hpop.trajectories.trajectory import Trajectory
from hpop.world.content.content import Landmark, Person
from tests.test_table import PANNED

EXAMPLES = Path(__file__).parents[1] / "examples"
MOST = 400  # characters: five lines of a terminal


@cache
def planned(name: str) -> hpop.Problem:
    return load_scenario(EXAMPLES / f"{name}.yaml").problem


def museum() -> hpop.Problem:
    return planned("museum")


def crowd() -> hpop.World:
    people = [Person(2 + 0.1 * i, 3) for i in range(200)]
    return museum().world.with_content(people=people, landmarks=[Landmark(5, 5)])


@cache
def way() -> Trajectory:
    return Trajectory.from_poses(museum().model, [(2 + 0.1 * i, 10 + 0.1 * (i % 2), 0) for i in range(400)])


def motions_of(trajectory: Trajectory) -> Motions:
    return next(trajectory.batches(museum().world))[1]


def still(problem: hpop.Problem) -> States:
    return problem.model.space.state(problem.start)


@cache
def graph(nodes: int = 2_000) -> Graph:
    rng = np.random.default_rng(0)
    tails, heads = rng.integers(0, nodes, (2, 6 * nodes))
    return Graph.from_arcs(nodes, tails, heads, rng.integers(1, 50, (6 * nodes, 2)))


def candidates() -> Candidates:
    return Candidates(
        objectives=museum().criteria[2:],
        trajectories=[way()] * 500,
        planned=np.zeros((500, 1)),
        tolerance=np.zeros((500, 1)),
        status=Status.COMPLETE,
        certificate="exact",
        provenance=({},) * 500,
    )


VALUES: dict[str, tuple[Callable[[], object], str]] = {
    "world": (crowd, "people: 200"),
    "ground": (lambda: crowd().ground, "<Ground: 30 x 20 m from (0, 0), obstacles: 35"),
    "ground of solids": (lambda: planned("arm_shelf").world.ground, "solids: 11"),
    "content": (lambda: crowd().content, "<Content: people: 200, landmarks: 1>"),
    "no content": (lambda: museum().world.content, "<Content: nothing>"),
    "problem": (museum, "from (2, 10, 0) to (28, 10, 0)"),
    "trajectory": (way, "399 move"),
    "states": (lambda: way().states, "of x, y, yaw>"),
    "pose": (lambda: museum().model.pose("camera", way().states), "of x, y, yaw>"),
    "pose of a head": (lambda: PANNED.model.pose("camera", PANNED.states), "of x, y, yaw, pan, tilt>"),
    "pose of an arm": (lambda: of_arm("arm_shelf").pose, "<ArmPose: <States: 1 of base_to_shoulder"),
    "twist of an arm": (lambda: of_arm("arm_shelf").twist, "<ArmTwist: "),
    "motions": (lambda: motions_of(way()), "of turn, DifferentialDrive in <World: "),
    "body": (lambda: motions_of(way()).camera, "<Body: from RigidPose"),
    "motions of a head": (lambda: motions_of(PANNED), "PanTilt in <World"),
    "history": (lambda: History(museum().world, way()), "399 move"),
    "trace": (lambda: museum().trace(way()), "<Trace: obstruction "),
    "pieces": (lambda: museum().trace(way()).pieces, "<TrajectoryPieces: "),
    "table of motions": (lambda: MotionTable.of([way(), way()]), "2 trajectories"),
    "table": (lambda: way().table(), "rows of t (s), x (m)"),
    "collision of an arm": (lambda: of_arm("arm_shelf").collision, "<ArmCollision: 6 joints>"),
    "judge of an arm": (lambda: of_arm("arm_shelf").judge, "<ArmJudge: 6 joints>"),
    "collision of an arm on a base": (lambda: of_arm("mobile_arm").collision.links, "joints>"),
    "pose of an arm on a base": (lambda: of_arm("mobile_arm").pose, "<ArmPose: <States: 1 of x, y, yaw"),
    "graph": (graph, "<Graph: 2,000 nodes, 12,000 arcs, 2 costs (sum, sum)>"),
    "paths": (lambda: pareto_paths(graph(), 0, 1_999), "of 2 costs; complete>"),
    "candidates": (candidates, "<Candidates: 500 by length; complete; exact>"),
}


@cache
def of_arm(name: str) -> SimpleNamespace:
    problem = planned(name)
    model, state = problem.model, still(problem)
    return SimpleNamespace(
        pose=model.pose("camera", state),
        twist=model.twist("tool", state, state),
        collision=model.collision(problem.world),
        judge=model.judge(problem.world),
    )


@pytest.mark.parametrize(("make", "said"), VALUES.values(), ids=VALUES)
def test_a_repr_is_short_and_says_what_it_is(make: Callable[[], object], said: str) -> None:
    shown = repr(make())
    assert said in shown
    assert len(shown) <= MOST
    assert "\n" not in shown


def test_points_and_fronts_are_short_whatever_they_hold() -> None:
    item = "x" * 10_000
    front = hpop.frontier.ItemFront.of(
        [[1.0, 2.0], [2.0, 1.0]], [item, item], names=("turns", "length"), units=("1", "m"), quanta=(1, 1),
        status="complete", certificate=" | ".join(["exact"] * 1_000), provenance=[{"w": list(range(1_000))}] * 2,
    )  # fmt: skip
    assert len(repr(front)) < MOST
    assert repr(front[0]).startswith("<Point 0 of its front: turns 1, length 2; 'xxx")
    assert len(repr(front[0])) < MOST
    assert "\\u200b" in repr(hpop.frontier.ItemFront.of([[1.0], [2.0]], names=("turns\u200b",)))
