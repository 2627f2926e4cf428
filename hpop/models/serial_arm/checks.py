"""Checks of the options of a serial arm: paths, poses, and mappings of names to numbers."""

from __future__ import annotations

import os
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.math import not_radians
from hpop.base.options import MOST, real
from hpop.base.text import shown
from hpop.errors import ModelError
from hpop.models.files import is_record, path_of
from hpop.models.serial_arm.xml import pose_of
from hpop.models.speeds import MOST_CLASSES

FARTHEST = 1e4  # m: largest coordinate in the options `base` and `camera`
SLOWEST = 1e-6
LEAST_SCALING = 1e-3
WORDS = {"urdf": "URDF", "srdf": "SRDF"}


def path_text(name: str, given: Any) -> str:
    """Check the option ``name``, a path or the record of a file in a saved front, and return the path as text."""
    path = path_of(given, WORDS.get(name, name)) if is_record(given) else given
    if not isinstance(path, str | os.PathLike) or not os.fspath(path):
        raise ModelError(f"{name} must be the path of a file, got {shown(given)}")
    return str(os.fspath(path))


def pose_matrix(name: str, given: Any) -> FloatArray:
    """Check the option ``name``, (x, y, z, roll, pitch, yaw) in m and rad, and return it as a pose (4, 4)."""
    try:
        numbers = [
            real(name, number, -FARTHEST, FARTHEST, "x, y, z, m, and roll, pitch, yaw, rad,", error=ModelError)
            for number in given
        ]
    except TypeError:
        numbers = []
    if len(numbers) != 6:
        raise ModelError(f"{name} must be (x, y, z, roll, pitch, yaw) in m and rad, got {shown(given)}")
    for angle in numbers[3:]:
        if advice := not_radians(angle):
            raise ModelError(f"an angle of {name} {advice}")
    return pose_of(np.array(numbers[:3]), np.array(numbers[3:]))


def checked_mapping(name: str, given: Any, what: str) -> dict[str, Any]:
    """Check the option ``name``, a mapping with names as keys, and return it as a dict.

    ``what`` says for messages what the values are.
    """
    if not isinstance(given, Mapping) or not all(isinstance(key, str) for key in given):
        raise ModelError(f"{name} must map names to {what}, as {{'name': ...}}, got {shown(given)}")
    return dict(given)


def checked_numbers(name: str, given: Any, least: float, what: str, most: float = MOST) -> dict[str, float]:
    """Check the option ``name``, which maps names to numbers from ``least`` to ``most``, and return it as a dict."""
    named = checked_mapping(name, given, what)
    return {key: float(real(f"{name} of {key}", value, least, most, error=ModelError)) for key, value in named.items()}


def checked_shares(given: Any) -> tuple[float, ...]:
    """Return the shares of the speeds, rising, from one share or a list of shares; raise ModelError for others."""
    several = tuple(given) if isinstance(given, list | tuple) else (given,)
    kind = "a share of the speeds" if len(several) == 1 else "a share of the speeds, or a list of rising shares, each"
    shares = tuple(float(real("velocity_scaling", each, LEAST_SCALING, 1, kind, error=ModelError)) for each in several)
    if not 1 <= len(shares) <= MOST_CLASSES or any(b <= a for a, b in pairwise(shares)):
        raise ModelError(
            f"velocity_scaling must be a share of the speeds, or a list of up to {MOST_CLASSES} rising shares, got "
            f"{shown(given)}; sort them, and give each once"
        )
    return shares
