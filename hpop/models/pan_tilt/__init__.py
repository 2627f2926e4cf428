"""A camera on a pan-tilt head on a base with two driven wheels."""

from hpop.models.pan_tilt.model import PanTilt

__all__ = ["PanTilt"]
