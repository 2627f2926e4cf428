"""Robot model "serial_arm": an arm, read from a URDF, with a camera at its end."""

from hpop.models.serial_arm.model import SerialArm

__all__ = ["SerialArm"]
