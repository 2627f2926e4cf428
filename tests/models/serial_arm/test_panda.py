"""The Panda on problems of MotionBenchMaker: its ends are free, and what is proved of its motions is so."""

import numpy as np
import pytest

from hpop.models.serial_arm.judge import LIBRARIES
from hpop.motions import Motions, States
from tests.worlds import NUMBERS, SETS, asked, panda


@pytest.mark.seeds(1, of=NUMBERS)
@pytest.mark.parametrize("name", SETS)
def test_starts_and_goals_are_free(shared_data, name, seed):
    data = shared_data("mbm_panda")
    arm, (world, start, goal) = panda(data), asked(data, name, seed)
    for values in (start, goal):
        state = arm.space.state(values)
        assert arm.collision(world).why_blocked(state) == ""
        for library in LIBRARIES:
            assert arm.judge_by(library, world).why_blocked(state) == ""


def test_closed_fingers_would_be_in_the_can(shared_data):
    """A wrong gripper is noticed: the goals have a can between the fingers."""
    data = shared_data("mbm_panda")
    arm = panda(data, fingers=0.0)
    for name in SETS:
        world, _, goal = asked(data, name, 1)
        assert "finger" in arm.collision(world).why_blocked(arm.space.state(goal))


@pytest.mark.seeds(1, of=30)
def test_what_is_proved_free_is_free_to_python_fcl_and_to_coal(shared_data, seed):
    data, rng = shared_data("mbm_panda"), np.random.default_rng(seed)
    arm = panda(data)
    world, _, _ = asked(data, SETS[seed % 2], 1 + seed // 2 % 20)
    collision = arm.collision(world)
    drawn = arm.space.sample(rng, 40 if seed == 0 else 120)
    free = drawn.take(np.flatnonzero(collision.states_free(drawn)))
    share = rng.choice([0.02, 0.2, 1.0], free.size, p=[0.4, 0.4, 0.2])
    other = free.take(rng.permutation(free.size))
    end = States(**{n: getattr(free, n) + share * (getattr(other, n) - getattr(free, n)) for n in free.names})
    motions = Motions(world, arm, arm.laws["reach"], free, end)
    proved = collision.motions_free(motions)
    for library in LIBRARIES:
        judged = arm.judge_by(library, world).motions_free(motions)
        assert not (proved & ~judged).any()
        assert (judged & ~proved).mean() < 0.05
    assert 0.3 < proved.mean() < 1.0
