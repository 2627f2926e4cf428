"""An arm on a base as one chain: two slides and a turn carry it, so that whatever the robot does is straight there.

With x, y and yaw as the first three joints, a drive, a turn in place and a reach each change joints evenly with the
share done. What is proved of an arm's motions is then proved of all of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.models.collision.parts import Part as Prism
from hpop.models.differential_drive.model import DifferentialDrive
from hpop.models.serial_arm.chain import Chain, Mount, Part
from hpop.models.serial_arm.self_collision import always_touching
from hpop.models.serial_arm.srdf import Pair, pair_of
from hpop.world.geometry.solids import Cylinder, Hull, Solid

BASE = 3  # joints by which the base moves, and the frame that moves with it
PLATFORM = "mobile base"  # as messages call it, among the links


def carried_chain(base: DifferentialDrive, chain: Chain) -> Chain:
    """The chain of an arm, its frame 0 now that of a base which x, y and yaw place in the world."""
    space, along, turning = base.space, [base.speed] * 2, base.turn_rate
    return Chain(
        names=(*space.names, *chain.names),
        sliding=np.array([True, True, False, *chain.sliding]),
        turning=np.array([False, False, True, *chain.turning]),
        axes=np.concatenate([np.eye(3), chain.axes]),
        origins=np.concatenate([np.tile(np.eye(4), (BASE, 1, 1)), chain.origins]),
        low=np.append(space.low, chain.low),
        high=np.append(space.high, chain.high),
        speed=np.array([*along, turning, *chain.speed]),
        acceleration=np.array([*[base.acceleration] * 2, base.turn_acceleration, *chain.acceleration]),
        mounts={name: Mount(BASE + mount.frame, mount.pose) for name, mount in chain.mounts.items()},
    )


def carried_parts(parts: Sequence[Part], platform: Sequence[Prism]) -> tuple[Part, ...]:
    """Solids of an arm in the frames of that chain, and those of the base."""
    return (
        *(replace(part, frame=BASE + part.frame) for part in parts),
        *(Part(PLATFORM, BASE, upright(prism)) for prism in platform),
    )


def upright(prism: Prism) -> Solid:
    """A prism of a base as a solid in its frame: a disc that is not grown from several corners, or a polygon."""
    pose, (z_min, z_max) = np.eye(4), (prism.z_min, prism.z_max)
    if len(prism.corners) == 1:
        pose[:3, 3] = (*prism.corners[0], 0.5 * (z_min + z_max))
        return Solid(Cylinder(prism.radius, z_max - z_min), pose, PLATFORM)
    points: FloatArray = np.array([(*corner, z) for z in (z_min, z_max) for corner in prism.corners])
    return Solid(Hull(points), pose, PLATFORM)


def touching_platform(
    chain: Chain, parts: Sequence[Part], apart: frozenset[Pair], platform: Sequence[Prism]
) -> frozenset[Pair]:
    """Pairs of a link and the base that touch in each of 10,000 states drawn of an arm: by design, as it stands there.

    Parts and frames are those of the arm's own chain.
    """
    links = dict.fromkeys(part.link for part in parts)
    known = apart | {pair_of(*pair) for pair in combinations(links, 2)}
    return always_touching(chain, [*parts, *(Part(PLATFORM, 0, upright(prism)) for prism in platform)], known)
