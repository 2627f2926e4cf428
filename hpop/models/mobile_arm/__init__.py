"""Robot model "mobile_arm": a mobile base that carries an arm with a camera at its end."""

from hpop.models.mobile_arm.model import MobileArm

__all__ = ["MobileArm"]
