"""The workspace, its fields, and the readers of maps."""

from hpop.world.field import Field
from hpop.world.ground import Ground
from hpop.world.shapes import Obstacle, Raster
from hpop.world.solids import Box, Cylinder, Hull, Solid, Sphere, pose_at
from hpop.world.world import World

__all__ = [
    "Box",
    "Cylinder",
    "Field",
    "Ground",
    "Hull",
    "Obstacle",
    "Raster",
    "Solid",
    "Sphere",
    "World",
    "pose_at",
]
