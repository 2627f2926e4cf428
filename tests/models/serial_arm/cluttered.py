"""Arms drawn at random, of all kinds of joints and shapes, among solids drawn at random."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from hpop.models.serial_arm.chain import ArmPart, Chain
from hpop.models.serial_arm.collision import ArmCollision
from hpop.models.serial_arm.judge import ArmJudge
from hpop.models.serial_arm.laws import Reach
from hpop.motions import Motions, States
from hpop.world import World
from hpop.world.geometry.solids import Box, Cylinder, Hull, Solid, Sphere


@dataclass(frozen=True, eq=False)
class Cluttered:
    """An arm in a world."""

    chain: Chain
    parts: tuple[ArmPart, ...]
    world: World
    apart: frozenset[tuple[str, str]]

    @property
    def collision(self) -> ArmCollision:
        return ArmCollision(self.chain, self.parts, self.apart, self.world)

    @property
    def judge(self) -> ArmJudge:
        return ArmJudge(self.chain, self.parts, self.apart, self.world)

    def states(self, rows) -> States:
        return States(**dict(zip(self.chain.names, np.asarray(rows, float).T, strict=True)))

    def motions(self, start, end, law=None) -> Motions:
        """From rows (M, n) to rows; the collisions read neither world nor model of the batch."""
        chain = self.chain
        law = law or Reach(chain.names, tuple(chain.speed), tuple(chain.acceleration))
        return Motions(self.world, None, law, self.states(start), self.states(end))

    def free(self, rng, count):
        """Free rows (N, n) among so many that are drawn."""
        rows = rng.uniform(self.chain.low, self.chain.high, (count, len(self.chain)))
        return rows[self.collision.states_free(self.states(rows))]


def pose(rng, spread) -> np.ndarray:
    found = np.eye(4)
    found[:3, :3] = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    found[:3, 3] = rng.uniform(-spread, spread, 3)
    return found


def shape(rng, low, high):
    sizes = rng.uniform(low, high, 3).tolist()
    return (
        lambda: Box(tuple(sizes)),
        lambda: Cylinder(sizes[0] / 2, sizes[1]),
        lambda: Sphere(sizes[0] / 2),
        lambda: Hull(rng.normal(size=(12, 3)) * np.array(sizes) / 2),
    )[rng.integers(4)]()


def cluttered(seed: int, *, joints: int = 5, solids: int = 8) -> Cluttered:
    """Joints that turn and slide about any axes, two parts a link, and solids of all shapes about."""
    rng = np.random.default_rng(seed)
    sliding = rng.random(joints) < 0.3
    axes = rng.normal(size=(joints, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    high = np.where(sliding, rng.uniform(0.05, 0.3, joints), rng.uniform(1.0, 3.0, joints))
    chain = Chain(
        names=tuple(f"joint{k}" for k in range(joints)),
        sliding=sliding,
        turning=np.zeros(joints, bool),
        axes=axes,
        origins=np.array([pose(rng, 0.25) for _ in range(joints)]),
        low=np.where(sliding, 0.0, -high),
        high=high,
        speed=np.ones(joints),
        acceleration=np.ones(joints),
    )
    parts = tuple(
        ArmPart(f"link{frame}", frame, Solid(shape(rng, 0.02, 0.15), pose(rng, 0.05)))
        for frame in range(joints + 1)
        for _ in range(2)
    )
    apart = frozenset((f"link{k}", f"link{k + 1}") for k in range(joints))
    about = [Solid(shape(rng, 0.05, 0.4), pose(rng, 0.8), f"solid{k}") for k in range(solids)]
    return Cluttered(chain, parts, World.from_solids(about), apart)
