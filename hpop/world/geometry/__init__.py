"""Shapes in the plane and solids in space, with distances, crossings and rays."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:  # imported on first use: numba is slow to import
    from hpop.world.geometry import _hulls as _hulls
    from hpop.world.geometry import _kernels as _kernels
    from hpop.world.geometry import _sight_in_space as _sight_in_space

__getattr__ = on_first_use(__name__, homes_of(__name__))
