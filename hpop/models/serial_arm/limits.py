"""Which limits of its joints an arm breaks along motions, and by how much."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray, IntArray
from hpop.models.serial_arm.chain import Chain
from hpop.motions import Law, States

BEYOND = 1e-6  # rad or m: so far beyond a limit is still at it
FASTER = 1e-6  # relative: so much faster than a limit is still at it


class Extremes(NamedTuple):
    """Of one joint along motions (M,): least and greatest values, and the greatest speed and acceleration, absolute."""

    low: FloatArray
    high: FloatArray
    speed: FloatArray
    acceleration: FloatArray


class JointLaw(Law, Protocol):
    """A law of an arm."""

    def ways(self, name: str, start: States, end: States) -> Column:
        """How far (M,), rad or m, a joint goes at most, there and back."""

    def extremes(self, name: str, start: States, end: States) -> Extremes:
        """Of a joint along each motion (M,), exact."""


class Excess(NamedTuple):
    """What motions (M,) come to at one limit of one joint.

    quantity  in words; of a value itself nothing
    value     (M,)
    over      (M,)  by how much it is beyond the limit; not positive where it keeps it
    """

    joint: str
    quantity: str
    unit: str
    limit: float
    value: FloatArray
    over: FloatArray


def excesses(chain: Chain, law: JointLaw, start: States, end: States) -> Iterator[Excess]:
    """Of each joint at each of its limits."""
    for i, name in enumerate(chain.names):
        found, unit = law.extremes(name, start, end), "m" if chain.sliding[i] else "rad"
        if not chain.turning[i]:
            low, high = float(chain.low[i]), float(chain.high[i])
            yield Excess(name, "", unit, low, found.low, low - found.low - BEYOND)
            yield Excess(name, "", unit, high, found.high, found.high - high - BEYOND)
        speed, acceleration = float(chain.speed[i]), float(chain.acceleration[i])
        yield Excess(name, "a speed of ", f"{unit}/s", speed, found.speed, found.speed - speed * (1 + FASTER))
        over = found.acceleration - acceleration * (1 + FASTER)
        yield Excess(name, "an acceleration of ", f"{unit}/s²", acceleration, found.acceleration, over)


def doubtful(chain: Chain, law: JointLaw, start: States, end: States) -> BoolArray:
    """Which motions (M,) break any."""
    broken = [excess.over > 0.0 for excess in excesses(chain, law, start, end)]
    return np.asarray(np.any(broken, axis=0))


def faults(chain: Chain, law: JointLaw, start: States, end: States, motions: IntArray) -> Iterator[str]:
    """Each limit that some motion (M,) of a trajectory breaks, in words, where it does so most."""
    for excess in excesses(chain, law, start, end):
        if excess.over.max(initial=0.0) > 0.0:
            i = int(np.argmax(excess.over))
            yield (
                f"has joint {excess.joint} at {excess.quantity}{excess.value[i]:.6g} {excess.unit} in motion "
                f"{motions[i]}, beyond its limit of {excess.limit:.6g}"
            )
