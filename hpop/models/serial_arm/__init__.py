"""Robot model "serial_arm": an arm, read from a URDF, with a camera at its end."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:  # imported on first use: numba is slow to import
    from hpop.models.serial_arm import certificate as certificate
    from hpop.models.serial_arm import distances as distances
    from hpop.models.serial_arm import postures as postures
    from hpop.models.serial_arm.model import SerialArm

__all__ = ["SerialArm"]

__getattr__ = on_first_use(__name__, homes_of(__name__))
