"""Worlds: the robot's workspace, with obstacles, people, scalar fields such as clearance, and readers of map files."""

from hpop.world.content.futures import Future
from hpop.world.content.people import Person
from hpop.world.fields.field import Field
from hpop.world.fields.measured import MeasuredField
from hpop.world.geometry.shapes import Obstacle, Raster
from hpop.world.geometry.solids import Box, Cylinder, Hull, Solid, Sphere, pose_at
from hpop.world.ground import Ground
from hpop.world.readers.commonroad import PlanningProblem, planning_problem
from hpop.world.readers.measured import read_field
from hpop.world.tracks import Track, read_tracks
from hpop.world.world import World

__all__ = [
    "Box",
    "Cylinder",
    "Field",
    "Future",
    "Ground",
    "Hull",
    "MeasuredField",
    "Obstacle",
    "Person",
    "PlanningProblem",
    "Raster",
    "Solid",
    "Sphere",
    "Track",
    "World",
    "planning_problem",
    "pose_at",
    "read_field",
    "read_tracks",
]
