"""Distances of an arm along motions agree with dense states to the proven tolerance, in both directions."""

import numpy as np
import pytest
import shapely

from hpop.criteria import make_criterion, motion_costs
from hpop.models.serial_arm.collision import MISSED, ROUNDING
from hpop.motions import Motions
from hpop.world import World
from hpop.world.geometry.solids import Box, Solid, pose_at
from tests.models.serial_arm.arms import arm6
from tests.models.serial_arm.cluttered import cluttered
from tests.models.serial_arm.test_certificate import gripper

MOST = 0.7
STEPS = 600
AROUND = shapely.box(-1, -1, 1, 1)


def reaches(arm, rng, count):
    """Rows between which motions lead, some far, some of no length, joints without limits included."""
    rows, others = (rng.uniform(arm.chain.low, arm.chain.high, (count, len(arm.chain))) for _ in range(2))
    return rows, rows + rng.choice([0.0, 0.05, 0.3, 1.0], (count, 1)) * (others - rows)


@pytest.mark.seeds(3, of=100)
def test_no_state_comes_nearer_and_one_comes_as_near(seed):
    """As near but for what a step between two dense states may hide: where the least is, to second order."""
    arm, rng = cluttered(seed, joints=2 + seed % 5), np.random.default_rng(seed)
    start, end = reaches(arm, rng, 25)
    least = arm.collision.least_clearance(arm.motions(start, end), MOST)
    shares = np.linspace(0.0, 1.0, STEPS + 1)[:, None, None]
    rows = (start + shares * (end - start)).reshape(-1, start.shape[1])
    dense = np.minimum(MOST, arm.collision.clearance(arm.states(rows)).reshape(-1, len(start)))
    assert (least <= dense.min(axis=0) + MISSED + 2 * ROUNDING).all()
    between = np.abs(np.diff(dense, axis=0)).max(axis=0)
    assert (least >= dense.min(axis=0) - between - MISSED).all()


@pytest.mark.parametrize("apart", [0.5, 0.45, 0.412])
def test_a_lever_comes_nearest_to_a_wall_where_it_is_straight_across(apart):
    """Its ball reaches 0.51 m there, the wall is at 0.1 m + apart."""
    arm = gripper(apart, slides=False)
    for ends in ([0.8, 2.2], [2.2, 0.8], [1.5, 1.6], [0.3, 1.9]):
        motions = arm.motions([ends[:1]], [ends[1:]])
        assert arm.collision.least_clearance(motions, 1.0)[0] == pytest.approx(apart - 0.41, abs=MISSED + 2 * ROUNDING)


def test_a_slide_comes_nearest_at_its_end():
    arm = gripper(0.3, slides=True)
    found = arm.collision.least_clearance(arm.motions([[-0.5], [-0.5]], [[0.1], [0.5]]), 1.0)
    np.testing.assert_allclose(found, [0.4 - 0.11, 0.0], atol=MISSED + 2 * ROUNDING)


@pytest.mark.seeds(2, of=20)
def test_a_motion_has_one_clearance_either_way_alone_or_in_a_batch(seed):
    """Bit for bit: an edge of a graph may be asked for the other way by a trajectory."""
    arm, rng = cluttered(seed), np.random.default_rng(seed)
    start, end = reaches(arm, rng, 30)
    there = arm.collision.least_clearance(arm.motions(start, end), MOST)
    both = arm.motions(np.concatenate([start, end]), np.concatenate([end, start]))
    assert arm.collision.least_clearance(both, MOST).tolist() == [*there, *there]
    alone = [arm.collision.least_clearance(arm.motions(end[i : i + 1], start[i : i + 1]), MOST)[0] for i in range(30)]
    assert alone == there.tolist()


def test_the_criterion_is_what_is_lacking_at_the_worst_moment():
    model = arm6()
    for solids in ([], [Solid(Box((0.3, 1.0, 0.02)), pose_at((0.65, 0.0, 0.36)), "board")]):
        world, rng = World.from_solids(solids, extent=AROUND), np.random.default_rng(4)
        a, b = model.space.sample(rng, 20), model.space.sample(rng, 20)
        motions = Motions(world, model, model.laws["reach"], a, b)
        worst = motions.worst(lambda s: np.maximum(0.5 - model.collision(world).clearance(s.state), 0.0))  # noqa: B023
        found = motion_costs(make_criterion({"clearance": {"enough": 0.5}}), motions)
        assert (found >= worst - MISSED - ROUNDING).all()
        np.testing.assert_allclose(found, worst, atol=2e-3)


def test_worst_moments_of_motions_there_and_back_are_looked_for_once():
    model, asked = arm6(), []
    a, b = (model.space.sample(np.random.default_rng(seed), 5) for seed in (1, 2))

    def worst(motions: Motions) -> np.ndarray:
        def rate(s):
            asked.append(s.state.size)
            return s.camera.z + s.camera.x**2

        asked.clear()
        return motions.worst(rate)

    def motions(start, end) -> Motions:
        return Motions(World.from_solids([], extent=AROUND), model, model.laws["reach"], start, end)

    there = worst(motions(a, b))
    alone = sum(asked)
    both = type(a)(**{n: np.append(getattr(a, n), getattr(b, n)) for n in a.names})
    back = type(a)(**{n: np.append(getattr(b, n), getattr(a, n)) for n in a.names})
    np.testing.assert_allclose(worst(motions(both, back)), [*there, *there], rtol=1e-12)
    assert sum(asked) <= alone + 1
