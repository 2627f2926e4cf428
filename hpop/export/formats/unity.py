"""Poses for Unity: left-handed, y up."""

from __future__ import annotations

import numpy as np

from hpop.export.base import Exported, export_format, rows_of_text

AXES = (
    "left-handed, x right, y up, z ahead (Unity), m; quaternion x, y, z, w; "
    "a heading of 0 (the world's x) looks along +z; t in s from the start"
)


@export_format("unity-csv", suffix=".unity.csv", axes=AXES)
def unity_csv(given: Exported) -> bytes:
    """A table for Unity: left-handed, x right, y up, z ahead, m.

    Columns ``t`` (s, from the start), ``x``, ``y``, ``z`` (m), ``qx``, ``qy``, ``qz``, ``qw``, as a transform's
    ``position`` and ``rotation`` take them. A point (x, y, z) of the world becomes (-y, z, x), a quaternion
    (q_y, -q_z, -q_x, q_w): ahead, left, up become forward, -right, up, as the ROS-TCP-Connector has it (FLU to RUF). A
    heading of 0, along the world's x, looks along +z. Lines that begin with ``#`` say this and the costs.
    """
    seen = given.poses
    x, y, z = seen.positions.T
    qx, qy, qz, qw = seen.quaternions.T
    table = np.column_stack([seen.times, -y, z, x, qy, -qz, -qx, qw]) + 0.0  # no -0.0
    said = "".join(f"# {line}\n" for line in given.statement(AXES))
    return (said + "t,x,y,z,qx,qy,qz,qw\n" + rows_of_text(table, ",")).encode()
