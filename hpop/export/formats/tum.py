"""Poses in the format of the TUM RGB-D benchmark."""

from __future__ import annotations

import numpy as np

from hpop.export.base import Exported, export_format, rows_of_text

AXES = (
    "right-handed, x and y on the floor, z up (REP-103), m; quaternion x, y, z, w of the body (x ahead, y left, z up); "
    "timestamp in s from the start"
)


@export_format("tum", suffix=".tum", axes=AXES)
def tum(given: Exported) -> bytes:
    """Lines ``timestamp tx ty tz qx qy qz qw`` of the TUM RGB-D benchmark, for evo and SLAM tools.

    s from the start, m, unit quaternion; right-handed, z up (REP-103). The axes of the body are x ahead, y left, z up,
    not those of a picture (z ahead), which some SLAM systems write. Lines that begin with ``#`` say this and the costs.
    Sturm et al. 2012, A benchmark for the evaluation of RGB-D SLAM systems, IROS.
    """
    seen = given.poses
    said = "".join(f"# {line}\n" for line in [*given.statement(AXES), "timestamp tx ty tz qx qy qz qw"])
    return (said + rows_of_text(np.column_stack([seen.times, seen.positions, seen.quaternions]), " ")).encode()
