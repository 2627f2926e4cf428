"""Bounds of the clearance of a driven trajectory: from its polyline, and from solutions by exact distances.

Each is a list of least field values (S,) at a program's samples, one array a height range.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from hpop.base.arrays import FloatArray
from hpop.planners.needs import on_wheels
from hpop.planners.polylines.polyline import Polyline
from hpop.planners.programs.smoothing.guess import legs
from hpop.planners.programs.smoothing.program import DrivenProgram
from hpop.trajectories.trajectory import Trajectory

MARGIN = 0.04  # m: kept beside the robot's reach, for what lies between two samples
SLACK = 1e-3  # m: by which the polyline itself keeps its bounds
ALONG = 0.1  # m: distance of the places at which the clearance of a polyline is read
DENSE = 0.03  # m: distance of the places at which a solution's clearance is checked


def along_polyline(program: DrivenProgram, polyline: Polyline) -> list[FloatArray]:
    """Return least field values (S,) at the program's samples, one array a height range.

    The robot's reach and a margin, but no more than the polyline has in the same phase and in those beside it: that is
    free, and the way through a narrow passage shall be feasible.
    """
    places, _ = legs(polyline)
    world, phase = program.problem.world, program.structure.phase[program.samples[0]]
    bounds = []
    for z, reach in program.spaces:
        field = world.clearance_field(z=z)
        least = []
        for leg in places:
            line = shapely.LineString(leg)
            stations = np.linspace(0.0, line.length, int(np.ceil(line.length / ALONG)) + 1)
            least.append(float(field(*shapely.get_coordinates(shapely.line_interpolate_point(line, stations)).T).min()))
        near = np.minimum.reduce([least, [*least[1:], np.inf], [np.inf, *least[:-1]]])
        bounds.append(np.minimum(reach + MARGIN, near - SLACK)[phase])
    return bounds


def exact(program: DrivenProgram, trajectory: Trajectory, spare: float) -> list[FloatArray]:
    """Return bounds that leave the robot ``spare`` metres at the samples, by exact distances along a solution."""
    here, world, found = trajectory.at(_times(program, trajectory)), program.problem.world, []
    for z, reach in program.spaces:
        distance = world.free_space(z).signed_clearance(here.x, here.y)
        found.append(world.clearance_field(z=z)(here.x, here.y) - (distance - reach) + spare)
    return found


def raised(
    program: DrivenProgram, bounds: Sequence[FloatArray], trajectory: Trajectory, spare: float
) -> list[FloatArray]:
    """Return bounds that are higher where a solution comes too near to an obstacle, by exact distances all along it.

    They are raised by ``spare`` metres more than what was lacking.
    """
    sampled, world = _times(program, trajectory), program.problem.world
    count = int(np.ceil(trajectory.duration * on_wheels(program.problem.model).speed / DENSE)) + 2
    times = np.linspace(0.0, trajectory.duration, count)
    at, here = trajectory.at(times), trajectory.at(sampled)
    nearest = np.clip(np.searchsorted(sampled, times), 1, len(sampled) - 1)
    found = []
    for (z, reach), bound in zip(program.spaces, bounds, strict=True):
        lacking = reach - world.free_space(z).signed_clearance(at.x, at.y)
        more = np.zeros(len(bound))
        for side in (nearest - 1, nearest):
            np.maximum.at(more, side, np.where(lacking > -spare, lacking + spare, 0.0))
        field = world.clearance_field(z=z)(here.x, here.y)
        found.append(np.where(more > 0, np.maximum(bound, field + more), bound))
    return found


def _times(program: DrivenProgram, trajectory: Trajectory) -> FloatArray:
    """Time (S,), s, of each sample."""
    owner, share = program.samples
    return np.asarray(trajectory.times[owner] + share * trajectory.durations[owner])
