"""Robot models; importing this package registers those that come with hpop."""

from hpop.models.differential_drive import DifferentialDrive

__all__ = ["DifferentialDrive"]
