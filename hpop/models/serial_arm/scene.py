"""An arm among what stands round it, as the arrays that :mod:`hpop.models.serial_arm.certificate` proves with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.models.collision.convex import Bodies, bodies_of
from hpop.models.serial_arm.chain import Chain, Part
from hpop.world.geometry.solids import Solid


class Scene(NamedTuple):
    """An arm of n joints and what stands round it, as arrays.

    origins  (n, 3, 4)  each joint's frame at value 0 in the frame before, the joint's axis along z
    sliding  (n,)
    bodies   B, each in its frame
    frames   (B,)       0 stands, i moves with joint i
    levers   (B, n)     m, no point of a body is farther from the axis of each joint that turns, slides between at 0
    pairs    (P, 2)     bodies whose distances are looked at, the one of the lower frame first
    """

    origins: FloatArray
    sliding: BoolArray
    bodies: Bodies
    frames: IntArray
    levers: FloatArray
    pairs: IntArray


def scene_of(chain: Chain, parts: Sequence[Part], solids: Sequence[Solid]) -> Scene:
    """Parts of an arm and what stands in the world: bodies in that order, and no pairs yet."""
    aligned = [np.eye(4), *map(_along_z, chain.axes)]
    origins = np.array(
        [before.T @ origin @ after for before, origin, after in zip(aligned, chain.origins, aligned[1:], strict=False)]
    ).reshape(-1, 4, 4)
    frames = np.array([*(part.frame for part in parts), *(0 for _ in solids)], np.int64)
    placed = [replace(part.solid, pose=aligned[part.frame].T @ part.solid.pose) for part in parts]
    bodies = bodies_of([*placed, *solids])
    return Scene(
        origins=np.ascontiguousarray(origins[:, :3]),
        sliding=np.array(chain.sliding, np.bool_),
        bodies=bodies,
        frames=frames,
        levers=_levers(origins, bodies, frames),
        pairs=np.zeros((0, 2), np.int64),
    )


def paired(scene: Scene, pairs: Sequence[tuple[int, int]]) -> Scene:
    """The scene with pairs to be looked at, those that move most first; bodies of one frame never come nearer."""
    rows = [sorted(pair, key=lambda b: int(scene.frames[b])) for pair in pairs]
    rows = [row for row in rows if scene.frames[row[0]] != scene.frames[row[1]]]
    rows.sort(key=lambda row: int(scene.frames[row[0]] - scene.frames[row[1]]))
    return scene._replace(pairs=np.array(rows, np.int64).reshape(-1, 2))


def within_reach(scene: Scene, chain: Chain, near: float) -> BoolArray:
    """Whether each body (B, B), its joints within their limits, may come so near, m, to another that never moves."""
    slides = np.where(chain.sliding, np.maximum(np.abs(chain.low), np.abs(chain.high)), 0.0)
    steps = np.append(slides[:1], np.linalg.norm(scene.origins[1:, :, 3], axis=1) + slides[1:])
    lengths = np.append(0.0, np.cumsum(steps))  # lengths[i]: from the origin of the first joint to that of frame i
    reach = lengths[scene.frames] + np.linalg.norm(scene.bodies.centre, axis=1) + scene.bodies.reach
    offs = scene.origins[0, :, 3] - scene.bodies.centre
    outside = np.abs(np.einsum("bij,bj->bi", scene.bodies.box[:, :3], offs)) - scene.bodies.box[:, 3]
    return np.asarray(np.linalg.norm(np.maximum(0.0, outside), axis=1) <= reach[:, None] + near)


def _along_z(axis: FloatArray) -> FloatArray:
    """A rotation (4, 4) that takes z to an axis; nothing for z itself."""
    if axis[2] == 1.0:
        return np.eye(4)
    other = np.eye(3)[np.argmin(np.abs(axis))]
    across = np.cross(axis, other) / np.linalg.norm(np.cross(axis, other))
    rotation = np.eye(4)
    rotation[:3, :3] = np.column_stack([across, np.cross(axis, across), axis])
    return rotation


def _levers(origins: FloatArray, bodies: Bodies, frames: IntArray) -> FloatArray:
    """Bounds (B, n), m, of the distance of each body's points from each joint's axis; 0 where it does not carry them.

    The next joint's origin is off the axis by its x and y; from there on lengths are added.
    """
    count = len(origins)
    offsets = origins[:, :3, 3]
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(offsets, axis=1))])  # lengths[k]: of offsets 0 to k - 1
    levers = np.zeros((frames.size, count))
    for b, frame in enumerate(frames.tolist()):
        points = bodies.points[bodies.first[b] : bodies.first[b + 1]]
        grown = bodies.disc[b] + bodies.ball[b]
        for k in range(frame - 1):
            between = lengths[frame] - lengths[k + 2]
            levers[b, k] = np.hypot(*offsets[k + 1, :2]) + between + np.linalg.norm(points, axis=1).max() + grown
        if frame:
            levers[b, frame - 1] = np.hypot(*points[:, :2].T).max() + grown
    return levers
