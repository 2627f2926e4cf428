"""What a conformance check is: a claim, and what contradicts it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.errors import HpopError

SAME = 1e-9  # m or rad, and relative: so far apart is the same
LEAST_SCALE = 1e-5  # of columns: where all is smaller, this is what a share is taken of


class Check(NamedTuple):
    """One conformance check: what it claims, and what contradicts it ("" where it holds)."""

    claim: str
    fault: str


def raise_faults(what: str, checks: Iterable[Check], error: type[HpopError]) -> None:
    """Raise an error that lists every check that fails, if any does."""
    faults = [f"{check.claim}: {check.fault}" for check in checks if check.fault]
    if faults:
        raise error(f"{what} fails {len(faults)} check{'s' * (len(faults) > 1)}:\n  " + "\n  ".join(faults))


def fault_of(test: Callable[[], str]) -> str:
    """What a check found; what is under test may raise anything, and that is a fault, not a crash."""
    try:
        return test()
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def differ(what: str, expected: FloatArray, found: FloatArray, tolerance: float, scale: float | None = None) -> str:
    """Where two columns differ by more than a share of each value and of a scale, by default that of the largest."""
    gap = np.abs(expected - found)
    largest = float(np.abs(expected).max(initial=0.0)) if scale is None else scale
    allowed = tolerance * np.maximum(np.abs(expected), max(largest, LEAST_SCALE))
    if np.all(gap <= allowed):  # not a number is a fault
        return ""
    worst = int(np.argmax(np.where(np.isnan(gap), np.inf, gap - allowed)))
    return f"{what}: expected {expected.flat[worst]:.6g}, found {found.flat[worst]:.6g}"
