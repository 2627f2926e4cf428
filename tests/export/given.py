"""Data for the tests of exports: robots of every kind, a front with odd names, a world with all content."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import shapely

import hpop
from hpop.motions import States
from hpop.problems.front import Front
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Ground
from hpop.world.content.content import Landmark, Person, Zone
from hpop.world.geometry.shapes import Obstacle
from tests.models.serial_arm.arms import arm6

ODD = "</script>\n\x1b[2J\u202e, 'Höhe' # \"%s\" {x: 1}"
DRIVE = hpop.DifferentialDrive(camera_offset=(0.2, -0.1), camera_height=1.3)
POSES = [(1, 1, 0), (3, 1, 0), (3, 3, 3.0)]
FRAME = shapely.box(0, 0, 8, 6).difference(shapely.box(0.2, 0.2, 7.8, 5.8))
TABLE = shapely.box(5, 2, 6, 3)


def through(model, *rows):
    return Trajectory.through(model, States(**dict(zip(model.space.names, np.array(rows, float).T, strict=True))))


@cache
def robots() -> dict[str, Trajectory]:
    """Return a trajectory of each kind of robot; one that holds, and one that stays in place."""
    goes = Trajectory.from_poses(DRIVE, POSES)
    return {
        "differential drive": goes,
        "holds": goes.with_hold(at=1, seconds=1.5),
        "stays": Trajectory.from_poses(DRIVE, [(2, 2, math.pi)]),
        "pan-tilt": through(hpop.PanTilt(), (1, 1, 0, 0, 0), (2, 1, 1, 1, 0.3), (2, 1, 1, -2, -0.4)),
        "serial arm": through(arm6(), (0.1,) * 6, (0.4,) * 6, (0.2,) * 6),
        "mobile arm": through(hpop.MobileArm(arm6()), (1, 1, 0, *(0.1,) * 6), (2, 1, 0.5, *(0.4,) * 6)),
    }


@cache
def problem() -> hpop.Problem:
    """Return a room with a wall round it, a table, people, landmarks and zones with odd names."""
    obstacles = (Obstacle(FRAME, name="wall"), Obstacle(TABLE, 0.7, 0.75, name=ODD))
    room = hpop.World(Ground(obstacles, extent=shapely.box(0, 0, 8, 6))).with_content(
        people=[Person(6.5, 5, yaw=-1.0, velocity=(-0.5, 0.25), name=ODD), Person(7, 1)],
        landmarks=[Landmark(7.5, 3, name=ODD, facing=math.pi), Landmark(4, 5.5)],
        zones=[Zone("speed", shapely.box(3, 4, 5, 5), limit=0.5, name=ODD)],
    )
    return hpop.Problem(room, DRIVE, POSES[0], POSES[-1], ["length", "turns"])


@cache
def front() -> Front:
    """Three rows; a criterion and the certificate have odd names."""
    several = [Trajectory.from_poses(DRIVE, [POSES[0], (2 + i, 1, 0), POSES[-1]]) for i in range(3)]
    costs = [[1.0, 9.0], [2.0, 3.0], [7.0, 0.1 + 0.2]]
    return Front.of(costs, several, names=[ODD, "length"], units=["1", "m"], certificate=ODD)
