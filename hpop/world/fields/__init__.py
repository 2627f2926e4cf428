"""Scalar fields over the plane, and the sampling of obstruction and clearance."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:  # imported on first use: numba and CasADi are slow to import
    from hpop.world.fields import _kernels as _kernels
    from hpop.world.fields import symbols as symbols

__getattr__ = on_first_use(__name__, homes_of(__name__))
