"""The workspace, its fields, and the readers of maps."""

from hpop.world.field import Field
from hpop.world.ground import Ground
from hpop.world.shapes import Obstacle, Raster
from hpop.world.world import World

__all__ = ["Field", "Ground", "Obstacle", "Raster", "World"]
