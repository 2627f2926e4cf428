"""How a head stands on a lattice: which pans and tilts there are at each heading, and how they join in place.

Pans are the multiples of 45 degrees within the end stops, of 90 where the headings are; tilts are both stops and 0, or
the middle where the stops leave 0 out. Then the head is where it must be after each turn back, unless a stop is passed.
"""

from __future__ import annotations

import math

import numpy as np

from hpop.arrays import FloatArray, IntArray
from hpop.errors import OptionError
from hpop.math import wrap
from hpop.models.base import Stations
from hpop.motions import States, StateSpace

ALIKE = 1e-9  # rad: two angles that differ by less are one
COARSEST = math.radians(90.0)  # between neighbouring pans
FINER = math.radians(45.0)


def stations(space: StateSpace, yaw: FloatArray) -> Stations:
    """Every pan and tilt at each heading (H,); "pan", "tilt", "turn" and "unwind" lead from one to others.

    Raises OptionError for headings that no pan can turn back, and for stops without a pan between them.
    """
    pans, tilts = _pans(space, yaw), _tilts(space)
    heading, pan, tilt = (index.ravel() for index in np.indices((yaw.size, pans.size, tilts.size)))
    zero = np.zeros(heading.size)
    states = States(x=zero, y=zero, yaw=yaw[heading], pan=pans[pan], tilt=tilts[tilt])
    number = np.arange(heading.size).reshape(yaw.size, pans.size, tilts.size)
    motions = {
        "turn": _joined(number, 0),
        "pan": _joined(number, 1),
        "tilt": _joined(number, 2),
        "unwind": _unwound(number, space, yaw, pans),
    }
    return Stations(states, heading, motions)


def _pans(space: StateSpace, yaw: FloatArray) -> FloatArray:
    """Pans (P,), rad, rising: as far apart as turning back between any two headings asks for."""
    turns = yaw - yaw[0]
    step = next((step for step in (COARSEST, FINER) if (np.abs(_off(turns, step)) < ALIKE).all()), None)
    if step is None:
        raise OptionError(
            f"{yaw.size} headings are no multiples of 45 degrees apart, so no pan of a lattice turns the head back as "
            "the base turns; take 4 or 8 headings"
        )
    column = space.names.index("pan")
    low, high = space.low[column], space.high[column]
    first = math.ceil(low / step - ALIKE) + ("pan" in space.turning)  # all round, half a turn is there once
    pans = step * np.arange(first, math.floor(high / step + ALIKE) + 1, dtype=np.float64)
    if not pans.size:
        raise OptionError(
            f"no multiple of {math.degrees(step):g} degrees is between the pan's stops at {low:.6g} and {high:.6g} rad"
            ", and a lattice has no other pans; let the stops be farther apart"
        )
    return pans


def _off(angles: FloatArray, step: float) -> FloatArray:
    """How far (N,), rad, angles are from a multiple of a step."""
    return np.asarray(angles - step * np.round(angles / step))


def _tilts(space: StateSpace) -> FloatArray:
    """Tilts, rad, rising: both stops, and 0 or the middle."""
    column = space.names.index("tilt")
    low, high = space.low[column], space.high[column]
    return np.unique([low, 0.0 if low <= 0.0 <= high else 0.5 * (low + high), high])


def _joined(number: IntArray, axis: int) -> tuple[IntArray, IntArray]:
    """Tails and heads of motions between any two stations that differ in one axis alone."""
    lines = np.moveaxis(number, axis, -1).reshape(-1, number.shape[axis])
    a, b = np.nonzero(~np.eye(lines.shape[1], dtype=bool))
    return lines[:, a].ravel(), lines[:, b].ravel()


def _unwound(number: IntArray, space: StateSpace, yaw: FloatArray, pans: FloatArray) -> tuple[IntArray, IntArray]:
    """Tails and heads of turns with the head turning back, where the pan that it needs is there."""
    turn = wrap(yaw[None, :] - yaw[:, None])  # (H, H), half a turn counter-clockwise
    view = turn[:, :, None, None] + pans[None, None, None, :] - pans[None, None, :, None]  # (H, H, P, P)
    stays = np.abs(wrap(view) if "pan" in space.turning else view) < ALIKE
    a, b, p, q = np.nonzero(stays & (turn != 0.0)[:, :, None, None])
    return number[a, p].ravel(), number[b, q].ravel()
