"""Poses for Unreal Engine: left-handed, z up, centimetres and degrees."""

from __future__ import annotations

import numpy as np

from hpop.export.base import Exported, export_format, rows_of_text
from hpop.export.turning import pitch_of, roll_of

AXES = (
    "left-handed, x ahead at heading 0, y right, z up (Unreal), cm; "
    "pitch up, yaw clockwise from above, roll to the right, degrees; t in s from the start"
)


@export_format("unreal-csv", suffix=".unreal.csv", axes=AXES)
def unreal_csv(given: Exported) -> bytes:
    """A table for Unreal Engine: left-handed, x along the world's x, y to its right, z up, cm.

    Columns ``t`` (s, from the start), ``x``, ``y``, ``z`` (cm), ``pitch``, ``yaw``, ``roll`` (degrees, as an FRotator
    has them: pitch up, yaw clockwise from above, roll to the right). A point (x, y, z) m of the world becomes
    (100 x, -100 y, 100 z); yaw changes its sign and is continuous, so that it may exceed 180. Lines that begin with
    ``#`` say this and the costs.
    """
    seen = given.poses
    angles = [pitch_of(seen.quaternions), -seen.yaws, roll_of(seen.quaternions)]
    table = np.column_stack([seen.times, seen.positions * [100.0, -100.0, 100.0], np.degrees(angles).T]) + 0.0
    said = "".join(f"# {line}\n" for line in given.statement(AXES))
    return (said + "t,x,y,z,pitch,yaw,roll\n" + rows_of_text(table, ",")).encode()
