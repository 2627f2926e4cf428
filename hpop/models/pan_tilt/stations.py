"""How a head stands on a lattice: which pans and tilts there are at each heading, and how they join in place.

Pans are the multiples of 45 degrees within the end stops, of 90 where the headings are; tilts are both stops and 0, or
the middle where the stops leave 0 out. Then the head is where it must be after each turn back, unless a stop is passed.
"""

from __future__ import annotations

import math

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.math import wrap
from hpop.errors import OptionError
from hpop.models.stations import Stations, grid_of_stations, stops_of
from hpop.motions import StateSpace

ALIKE = 1e-9  # rad: two angles that differ by less are one
COARSEST = math.radians(90.0)  # between neighbouring pans
FINER = math.radians(45.0)


def stations(space: StateSpace, yaw: FloatArray) -> Stations:
    """Every pan and tilt at each heading (H,); "pan", "tilt", "turn" and "unwind" lead from one to others.

    Raises OptionError for headings that no pan can turn back, and for stops without a pan between them.
    """
    pans = _pans(space, yaw)
    found, number = grid_of_stations(yaw, {"pan": pans, "tilt": stops_of(space, "tilt")})
    return found._replace(motions={**found.motions, "unwind": _unwound(number, space, yaw, pans)})


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


def _unwound(number: IntArray, space: StateSpace, yaw: FloatArray, pans: FloatArray) -> tuple[IntArray, IntArray]:
    """Tails and heads of turns with the head turning back, where the pan that it needs is there."""
    turn = wrap(yaw[None, :] - yaw[:, None])  # (H, H), half a turn counter-clockwise
    view = turn[:, :, None, None] + pans[None, None, None, :] - pans[None, None, :, None]  # (H, H, P, P)
    stays = np.abs(wrap(view) if "pan" in space.turning else view) < ALIKE
    a, b, p, q = np.nonzero(stays & (turn != 0.0)[:, :, None, None])
    return number[a, p].ravel(), number[b, q].ravel()
