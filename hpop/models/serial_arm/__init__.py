"""A serial arm with a camera in its hand."""

from hpop.models.serial_arm.model import SerialArm

__all__ = ["SerialArm"]
