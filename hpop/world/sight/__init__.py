"""Sight of a camera: distances along bearings, landmarks in view, and the openness of the space round it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:  # imported on first use: numba is slow to import
    from hpop.world.sight import _kernels as _kernels

__getattr__ = on_first_use(__name__, homes_of(__name__))
