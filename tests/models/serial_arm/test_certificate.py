"""Proofs that whole motions of arms are free: judged by python-fcl and coal, and no more careful than they say."""

from dataclasses import replace

import numpy as np
import pytest

from hpop.models.serial_arm.chain import ArmPart, Chain
from hpop.models.serial_arm.collision import KEPT, NEAR
from hpop.models.serial_arm.judge import LIBRARIES, STEP
from hpop.world import World
from hpop.world.geometry.solids import Box, Solid, Sphere, pose_at
from tests.models.serial_arm.cluttered import Cluttered, cluttered


def edges(arm, rng, count):
    """Motions between free states: to near ones, and to any."""
    rows = arm.free(rng, count)
    reach = rng.choice([0.05, 0.3, 1.0], (len(rows), 1))
    return rows, rows + reach * (rng.permutation(rows) - rows)


@pytest.mark.seeds(1, of=100)
def test_what_is_proved_free_is_free_to_python_fcl_and_to_coal_at_steps_of_1_mm(seed):
    arm, rng = cluttered(seed, joints=3 + seed % 5), np.random.default_rng(seed)
    motions = arm.motions(*edges(arm, rng, 60))
    free = arm.collision.motions_free(motions)
    for library in LIBRARIES:
        judged = replace(arm.judge, library=library).motions_free(motions)
        assert not (free & ~judged).any()
        if len(motions) > 20:
            assert (judged & ~free).mean() < 0.1


@pytest.mark.seeds(1, of=50)
def test_what_is_blocked_comes_nearer_than_1_mm_and_what_is_free_does_not_come_nearer_than_half_of_that(seed):
    """Clearances of dense states, own links left out: these are looked at in between steps by no more than a step."""
    arm, rng = cluttered(seed, joints=4), np.random.default_rng(seed)
    arm = replace(arm, apart=frozenset((f"link{a}", f"link{b}") for a in range(5) for b in range(a, 5)))
    start, end = edges(arm, rng, 25)
    free = arm.collision.motions_free(arm.motions(start, end))
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    for i in range(len(start)):
        rows = start[i] + share * (end[i] - start[i])
        least = arm.collision.clearance(arm.states(rows)).min()
        assert least >= KEPT - 1e-5 if free[i] else least <= NEAR + STEP


@pytest.mark.seeds(1, of=50)
def test_each_state_of_a_free_motion_is_free(seed):
    arm, rng = cluttered(seed), np.random.default_rng(seed)
    start, end = edges(arm, rng, 60)
    free = arm.collision.motions_free(arm.motions(start, end))
    for share in rng.random(20):
        assert arm.collision.states_free(arm.states(start + share * (end - start)))[free].all()


def gripper(apart: float, *, slides: bool, tip: float = 0.5) -> Cluttered:
    """Return a ball of 1 cm on a lever, or on a slide along y, beside a wall that begins at y = 0.1 + ``apart``."""
    chain = Chain(
        names=("joint",),
        sliding=np.array([slides]),
        turning=np.array([False]),
        axes=np.array([[0.0, 1.0, 0.0] if slides else [0.0, 0.0, 1.0]]),
        origins=np.eye(4)[None],
        low=np.array([-3.0]),
        high=np.array([3.0]),
        speed=np.ones(1),
        acceleration=np.ones(1),
    )
    part = ArmPart("hand", 1, Solid(Sphere(0.01), pose_at((tip, 0.0, 0.0))))
    wall = Solid(Box((4.0, 0.2, 4.0)), pose_at((0.0, 0.2 + apart, 0.0)), "wall")
    return Cluttered(chain, (part,), World.from_solids([wall]), frozenset())


@pytest.mark.parametrize(
    ("apart", "free"),
    [(0.0112, True), (0.0104, False), (0.01, False), (0.0, False)],
)
def test_a_slide_may_come_as_near_to_a_wall_as_half_a_millimetre(apart, free):
    arm = gripper(apart, slides=True)
    (found,) = arm.collision.motions_free(arm.motions([[-0.5]], [[0.1]]))
    assert found == free


def test_a_lever_grazes_a_wall_between_two_free_ends():
    """In the middle its ball reaches 0.51 m, to a wall at 0.512 or at 0.509 m."""
    for apart, free in ((0.412, True), (0.409, False)):
        arm = gripper(apart, slides=False)
        ends = np.array([[0.8], [2.2]])
        assert arm.collision.states_free(arm.states(ends)).all()
        assert arm.collision.motions_free(arm.motions(ends[:1], ends[1:])) == free
        assert arm.judge.motions_free(arm.motions(ends[:1], ends[1:])) == free


@pytest.mark.parametrize(("apart", "free"), [(0.0001, False), (0.0004, False), (0.0011, True)])
def test_a_wall_just_out_of_reach_is_too_near_as_well(apart, free):
    """An outstretched ball reaches 0.51 m and no farther."""
    arm = gripper(0.1, slides=False)
    wall = Solid(Box((0.2, 4.0, 4.0)), pose_at((0.61 + apart, 0.0, 0.0)), "wall")
    arm = replace(arm, world=World.from_solids([wall]))
    (state,) = arm.collision.states_free(arm.states([[0.0]]))
    (motion,) = arm.collision.motions_free(arm.motions([[-0.5]], [[0.5]]))
    assert (state, motion) == (free, free)


def test_a_thin_wall_is_not_stepped_over():
    """1 mm of wall, between states 3 rad apart."""
    arm = gripper(0.1, slides=False)
    thin = Solid(Box((0.001, 0.001, 0.001)), pose_at((0.0, 0.5, 0.0)))
    arm = replace(arm, world=World.from_solids([thin]))
    assert not arm.collision.motions_free(arm.motions([[0.0]], [[3.0]]))
    assert not arm.judge.motions_free(arm.motions([[0.0]], [[3.0]]))


def test_what_a_batch_is_cut_into_changes_no_answer():
    arm, rng = cluttered(3), np.random.default_rng(3)
    start, end = edges(arm, rng, 400)
    together = arm.collision.motions_free(arm.motions(start, end))
    alone = [arm.collision.motions_free(arm.motions(start[i : i + 1], end[i : i + 1]))[0] for i in range(len(start))]
    assert together.tolist() == alone
    assert 0.1 < together.mean() < 0.95


class Bowed:
    """A law of cubic curves: off the straight way by a share of it that is greatest a third along."""

    kind = "bowed"

    def __init__(self, names, bow):
        self.names, self.varies, self.bow = names, frozenset(names), bow

    def interpolate(self, name, start, end, share):
        a, b = getattr(start, name), getattr(end, name)
        return a + (b - a) * share + self._sign(name) * share * (1 - share) * (1 + share)

    def slopes(self, name, start, end, share):
        a, b = getattr(start, name), getattr(end, name)
        return b - a + self._sign(name) * (1 - 3 * share**2), -6 * self._sign(name) * share

    def strays(self, start, end):
        return 0.0 * getattr(start, self.names[0])

    def phases(self, start, end):
        raise NotImplementedError

    def _sign(self, name):
        return self.bow * (-1) ** self.names.index(name)


@pytest.mark.seeds(1, of=30)
def test_curves_proved_free_are_free_to_python_fcl(seed):
    arm, rng = cluttered(seed, joints=4), np.random.default_rng(seed)
    start, end = edges(arm, rng, 60)
    motions = arm.motions(start, end, Bowed(arm.chain.names, 0.3))
    free, judged = arm.collision.motions_free(motions), arm.judge.motions_free(motions)
    assert not (free & ~judged).any()
    if len(motions) > 20:
        assert (judged & ~free).mean() < 0.1
        assert (free != arm.collision.motions_free(arm.motions(start, end))).any()


def test_a_long_way_close_along_a_wall_is_decided_to_its_end():
    """A ball slides 2 m along a wall of 60 boxes, 1.2 mm off: some thousand looks, and room for all that is left."""
    arm = gripper(0.0, slides=True)
    chain = replace(arm.chain, axes=np.array([[1.0, 0.0, 0.0]]))
    part = ArmPart("hand", 1, Solid(Sphere(0.01), np.eye(4)))
    wall = [Solid(Box((0.05, 0.1, 0.1)), pose_at((0.05 * k - 1.5, 0.0612, 0.0)), f"brick {k}") for k in range(60)]
    way = [[-1.0]], [[1.0]]
    for needle, free in (([], True), ([Solid(Sphere(0.0005), pose_at((0.987, 0.0, 0.0102)))], False)):
        arm = Cluttered(chain, (part,), World.from_solids([*wall, *needle]), frozenset())
        assert arm.collision.motions_free(arm.motions(*way)) == free
        assert arm.judge.motions_free(arm.motions(*way)) == free


def test_the_answer_does_not_depend_on_how_many_threads_ask():
    from concurrent.futures import ThreadPoolExecutor

    arm, rng = cluttered(5), np.random.default_rng(5)
    start, end = edges(arm, rng, 100)
    collision = arm.collision

    def ask(i):
        return collision.motions_free(arm.motions(start[i::4], end[i::4]))

    with ThreadPoolExecutor(4) as threads:
        parts = [*threads.map(ask, range(4))]
    together = collision.motions_free(arm.motions(start, end))
    assert all((together[i::4] == part).all() for i, part in enumerate(parts))
