"""A mobile base that carries an arm with a camera in its hand."""

from hpop.models.mobile_arm.model import MobileArm

__all__ = ["MobileArm"]
