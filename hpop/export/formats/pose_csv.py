"""Poses as comma-separated values, in the world's frame."""

from __future__ import annotations

import numpy as np

from hpop.export.base import Exported, export_format, rows_of_text

AXES = (
    "right-handed, x and y on the floor, z up (REP-103), m; quaternion x, y, z, w of the body (x ahead, y left, z up); "
    "v m/s forward, yaw_rate rad/s counter-clockwise; t in s from the start"
)


@export_format("csv", suffix=".csv", axes=AXES)
def pose_csv(given: Exported) -> bytes:
    """A table of poses, in the world's frame, for spreadsheets and scripts.

    Columns ``t`` (s, from the start), ``x``, ``y``, ``z`` (m), ``qx``, ``qy``, ``qz``, ``qw`` (unit quaternion that
    turns the world's axes to those of the body: x ahead, y left, z up; each on the side of the one before it, so that
    interpolation goes the shorter way), ``v`` (m/s, the velocity along the direction ahead), ``yaw_rate`` (rad/s,
    about the vertical, counter-clockwise). Right-handed, z up (REP-103). Lines that begin with ``#`` say
    this and the costs: ``pandas.read_csv(file, comment="#")``. Numbers read back as the same float64.
    """
    seen = given.poses
    table = np.column_stack([seen.times, seen.positions, seen.quaternions, seen.speeds, seen.yaw_rates])
    said = "".join(f"# {line}\n" for line in given.statement(AXES))
    return (said + "t,x,y,z,qx,qy,qz,qw,v,yaw_rate\n" + rows_of_text(table, ",")).encode()
