"""Serial arms with a camera in the hand."""

from hpop.models.serial_arm.model import SerialArm

__all__ = ["SerialArm"]
