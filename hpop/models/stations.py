"""How a robot with joints stands on a lattice: which joint values there are at each heading, and how they join."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.motions import States, StateSpace


class Stations(NamedTuple):
    """States in which a model may be at one place of a lattice, and its motions in place.

    states    (S,)  x and y are 0
    headings  (S,)  the heading of each, as its place among those of the lattice, along which its moves go
    motions         tails and heads (E,), stations, of the motions in place by kind
    """

    states: States
    headings: IntArray
    motions: Mapping[str, tuple[IntArray, IntArray]]


def grid_of_stations(yaw: FloatArray, joints: Mapping[str, FloatArray]) -> tuple[Stations, IntArray]:
    """Return every combination of headings (H,), rad, and values of joints, and its number by heading and values.

    "turn" leads from a heading to any other, the law of a joint's name from a value to any other.
    """
    shape = (yaw.size, *(values.size for values in joints.values()))
    heading, *at = (index.ravel() for index in np.indices(shape))
    zero, number = np.zeros(heading.size), np.arange(heading.size).reshape(shape)
    columns = {name: values[index] for (name, values), index in zip(joints.items(), at, strict=True)}
    motions = {kind: _joined(number, axis) for axis, kind in enumerate(("turn", *joints))}
    return Stations(States(x=zero, y=zero, yaw=yaw[heading], **columns), heading, motions), number


def _joined(number: IntArray, axis: int) -> tuple[IntArray, IntArray]:
    """Tails and heads of motions between any two stations that differ in one axis alone."""
    lines = np.moveaxis(number, axis, -1).reshape(-1, number.shape[axis])
    a, b = np.nonzero(~np.eye(lines.shape[1], dtype=bool))
    return lines[:, a].ravel(), lines[:, b].ravel()


def stops_of(space: StateSpace, joint: str) -> FloatArray:
    """Return both stops of a joint, and 0, or their middle where they leave 0 out; rising."""
    column = space.names.index(joint)
    low, high = space.low[column], space.high[column]
    return np.unique([low, 0.0 if low <= 0.0 <= high else 0.5 * (low + high), high])
