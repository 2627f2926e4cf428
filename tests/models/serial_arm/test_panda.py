"""The Panda on problems of MotionBenchMaker: its ends are free, and what is proved of its motions is so.

Its meshes and URDF are those of the wheel example-robot-data; the fingers are 40 mm out, as far as they go. The
requests say 65 mm.
"""

import importlib.metadata
from functools import cache

import numpy as np
import pytest
import yaml

from hpop.models.serial_arm.model import SerialArm
from hpop.motions import Motions, States
from hpop.world import World

SETS = ("bookshelf_small", "table_pick")


@pytest.fixture(scope="module")
def panda(shared_data):
    try:
        files = importlib.metadata.files("example-robot-data") or ()
    except importlib.metadata.PackageNotFoundError:
        files = ()
    urdf = next((file.locate() for file in files if str(file).endswith("panda_description/urdf/panda.urdf")), None)
    if urdf is None:
        pytest.skip("the Panda's meshes are in the wheel example-robot-data, which is not installed")

    @cache
    def made(fingers):
        return SerialArm.from_urdf(
            urdf,
            tip="panda_hand",
            acceleration=5.0,
            srdf=shared_data("mbm_panda") / "panda.srdf",
            packages={"example-robot-data": urdf.parents[3]},
            fixed={"panda_finger_joint1": fingers, "panda_finger_joint2": fingers},
        )

    return made


@pytest.fixture(scope="module")
def problems(shared_data):
    """World, start and goal of a problem by set and number."""

    def read(name, number):
        folder = shared_data("mbm_panda") / "problems" / f"{name}_panda"
        request = yaml.load((folder / f"request{number:04d}.yaml").read_text(), yaml.CSafeLoader)
        given = request["start_state"]["joint_state"]
        start = dict(zip(given["name"], given["position"], strict=True))
        goal = {one["joint_name"]: one["position"] for one in request["goal_constraints"][0]["joint_constraints"]}
        return (
            World.from_moveit_scene(folder / f"scene{number:04d}.yaml"),
            {name: start[name] for name in goal},
            goal,
        )

    return read


@pytest.mark.seeds(1, of=range(1, 21))
@pytest.mark.parametrize("name", SETS)
def test_starts_and_goals_are_free(panda, problems, name, seed):
    arm = panda(0.04)
    world, start, goal = problems(name, seed)
    for values in (start, goal):
        state = arm.space.state(values)
        assert arm.collision(world).why_blocked(state) == ""
        assert arm.judge(world).why_blocked(state) == ""


def test_closed_fingers_would_be_in_the_can(panda, problems):
    """A wrong gripper is noticed: the goals have a can between the fingers."""
    arm = panda(0.0)
    for name in SETS:
        world, _, goal = problems(name, 1)
        assert "finger" in arm.collision(world).why_blocked(arm.space.state(goal))


@pytest.mark.seeds(1, of=60)
def test_what_is_proved_free_is_free_to_python_fcl(panda, problems, seed):
    arm, rng = panda(0.04), np.random.default_rng(seed)
    world, _, _ = problems(SETS[seed % 2], 1 + seed // 2 % 20)
    collision = arm.collision(world)
    drawn = arm.space.sample(rng, 40 if seed == 0 else 120)
    free = drawn.take(np.flatnonzero(collision.states_free(drawn)))
    share = rng.choice([0.02, 0.2, 1.0], free.size, p=[0.4, 0.4, 0.2])
    other = free.take(rng.permutation(free.size))
    end = States(**{n: getattr(free, n) + share * (getattr(other, n) - getattr(free, n)) for n in free.names})
    motions = Motions(world, arm, arm.laws["reach"], free, end)
    proved, judged = collision.motions_free(motions), arm.judge(world).motions_free(motions)
    assert not (proved & ~judged).any()
    assert (judged & ~proved).mean() < 0.05
    assert 0.3 < proved.mean() < 1.0
