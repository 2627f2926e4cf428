"""A base with two driven wheels and a camera on a mast: the robot, its motion laws, and its curves."""

from hpop.models.differential_drive.model import DifferentialDrive

__all__ = ["DifferentialDrive"]
