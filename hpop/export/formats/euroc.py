"""Poses in the format of the EuRoC MAV data sets."""

from __future__ import annotations

from hpop.export.base import Exported, export_format
from hpop.trajectories.poses import nanoseconds

AXES = (
    "right-handed, x and y on the floor, z up (REP-103), m; quaternion w, x, y, z of the body (x ahead, y left, z up); "
    "timestamp in whole ns from the start"
)
HEAD = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"


@export_format("euroc", suffix=".euroc.csv", axes=AXES)
def euroc(given: Exported) -> bytes:
    """The ground truth table of the EuRoC MAV data sets, for evo and visual-inertial tools.

    Columns: time in whole nanoseconds from the start, position (m), unit quaternion with w first; one line of headings,
    as in these. Right-handed, z up (REP-103); the axes of the body are x ahead, y left, z up.
    Burri et al. 2016, The EuRoC micro aerial vehicle datasets, IJRR 35(10).
    """
    seen = given.poses
    lines = [HEAD]
    for time, place, (x, y, z, w) in zip(
        nanoseconds(seen.times).tolist(), seen.positions.tolist(), seen.quaternions.tolist(), strict=True
    ):
        lines.append(",".join(map(repr, (time, *place, w, x, y, z))))
    return ("\n".join(lines) + "\n").encode()
