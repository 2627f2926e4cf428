"""Export formats with poses along a trajectory as text: CSV, JSON, EuRoC, TUM, Unity and Unreal Engine."""

from __future__ import annotations

import numpy as np

from hpop.export.base import PROGRAM, Exported, export_format, pitch_of, roll_of, rows_of_text
from hpop.export.joints import joint_csv
from hpop.frontier import strict_json
from hpop.motions.bodies import JOINTS
from hpop.trajectories.poses import nanoseconds

CSV_AXES = (
    "right-handed, x and y on the floor, z up (REP-103), m; quaternion x, y, z, w of the body (x ahead, y left, z up); "
    "v m/s forward, yaw_rate rad/s counter-clockwise; t in s from the start"
)


@export_format("csv", suffix=".csv", axes=CSV_AXES)
def pose_csv(given: Exported) -> bytes:
    """Return a table of poses in the world's frame, or of joints, for spreadsheets and scripts.

    Columns for poses:

    - ``t``: time from the start, s
    - ``x``, ``y``, ``z``: position, m; axes are right-handed with z up (REP-103)
    - ``qx``, ``qy``, ``qz``, ``qw``: unit quaternion that turns the world's axes to those of the body (x ahead, y left,
      z up); its sign is chosen so that interpolation takes the shorter way
    - ``v``: velocity along the direction ahead, m/s
    - ``yaw_rate``: rate of turning about the vertical, rad/s, counter-clockwise

    Columns for the body "joints", from base to tip: ``t``; the value of each joint, rad or m; ``<joint>_rate``, rad/s
    or m/s; ``<joint>_acceleration``, rad/s² or m/s².

    Lines that begin with ``#`` state the axes and the costs, so read it with ``pandas.read_csv(file, comment="#")``.
    Numbers read back as equal float64.
    """
    if given.body == JOINTS:
        return joint_csv(given)
    seen = given.poses
    table = np.column_stack([seen.times, seen.positions, seen.quaternions, seen.speeds, seen.yaw_rates])
    said = "".join(f"# {line}\n" for line in given.statement(CSV_AXES))
    return (said + "t,x,y,z,qx,qy,qz,qw,v,yaw_rate\n" + rows_of_text(table, ",")).encode()


JSON_AXES = (
    "right-handed, x and y on the floor, z up (REP-103), m; quaternions x, y, z, w of the body (x ahead, y left); "
    "speeds m/s forward, yaws rad and yaw_rates rad/s counter-clockwise; times in s from the start"
)


@export_format("json", suffix=".json", axes=JSON_AXES)
def pose_json(given: Exported) -> bytes:
    """Return a JSON object of poses, in the world's frame, with its costs, for web pages and scripts.

    These keys have one entry for each pose:

    - ``times``: s, from the start
    - ``positions``: [x, y, z] in m; axes are right-handed with z up (REP-103)
    - ``quaternions``: [x, y, z, w], unit quaternions that turn the world's axes to those of the body (x ahead, y left,
      z up)
    - ``yaws``: rad, without jumps at a full turn
    - ``speeds``: m/s, along the direction ahead
    - ``yaw_rates``: rad/s, counter-clockwise

    The key ``axes`` states this in words. The file is strict JSON in UTF-8. Numbers read back as equal float64.
    """
    seen = given.poses
    told = {
        "schema": "hpop-poses",
        "version": 1,
        "program": PROGRAM,
        "axes": JSON_AXES,
        "frame": given.frames.world,
        "body": given.body,
        "planned": given.planned,
        "rate": float(given.rate),
        "row": given.row,
        "name": given.name,
        "costs": dict(given.costs),
        "units": dict(given.units),
        "times": seen.times.tolist(),
        "positions": seen.positions.tolist(),
        "quaternions": seen.quaternions.tolist(),
        "yaws": seen.yaws.tolist(),
        "speeds": seen.speeds.tolist(),
        "yaw_rates": seen.yaw_rates.tolist(),
    }
    return "".join([*strict_json.pieces(told), "\n"]).encode()


EUROC_AXES = (
    "right-handed, x and y on the floor, z up (REP-103), m; quaternion w, x, y, z of the body (x ahead, y left, z up); "
    "timestamp in whole ns from the start"
)
HEAD = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"


@export_format("euroc", suffix=".euroc.csv", axes=EUROC_AXES)
def euroc(given: Exported) -> bytes:
    """Return a ground truth table as in the EuRoC MAV data sets, for evo and visual-inertial tools.

    After one line of headings, the columns are: time from the start in whole nanoseconds, position in m, and unit
    quaternion with w first. Axes are right-handed with z up (REP-103). The axes of the body are x ahead, y left, z up.

    Source: Burri et al. 2016, The EuRoC micro aerial vehicle datasets, IJRR 35(10).
    """
    seen = given.poses
    lines = [HEAD]
    for time, place, (x, y, z, w) in zip(
        nanoseconds(seen.times).tolist(), seen.positions.tolist(), seen.quaternions.tolist(), strict=True
    ):
        lines.append(",".join(map(repr, (time, *place, w, x, y, z))))
    return ("\n".join(lines) + "\n").encode()


TUM_AXES = (
    "right-handed, x and y on the floor, z up (REP-103), m; quaternion x, y, z, w of the body (x ahead, y left, z up); "
    "timestamp in s from the start"
)


@export_format("tum", suffix=".tum", axes=TUM_AXES)
def tum(given: Exported) -> bytes:
    """Return lines ``timestamp tx ty tz qx qy qz qw`` of the TUM RGB-D benchmark, for evo and SLAM tools.

    Each line has the time from the start in s, the position in m, and a unit quaternion. Axes are right-handed with z
    up (REP-103). The axes of the body are x ahead, y left, z up. Some SLAM systems write other axes of the camera, with
    z ahead. Lines that begin with ``#`` state the axes and the costs.

    Source: Sturm et al. 2012, A benchmark for the evaluation of RGB-D SLAM systems, IROS.
    """
    seen = given.poses
    said = "".join(f"# {line}\n" for line in [*given.statement(TUM_AXES), "timestamp tx ty tz qx qy qz qw"])
    return (said + rows_of_text(np.column_stack([seen.times, seen.positions, seen.quaternions]), " ")).encode()


UNITY_AXES = (
    "left-handed, x right, y up, z ahead (Unity), m; quaternion x, y, z, w; "
    "a heading of 0 (the world's x) looks along +z; t in s from the start"
)


@export_format("unity-csv", suffix=".unity.csv", axes=UNITY_AXES)
def unity_csv(given: Exported) -> bytes:
    """Return a table for Unity: left-handed, x right, y up, z ahead, m.

    Columns are ``t`` (s, from the start), ``x``, ``y``, ``z`` (m), and ``qx``, ``qy``, ``qz``, ``qw``. Assign them to
    the ``position`` and ``rotation`` of a transform. A point (x, y, z) of the world becomes (-y, z, x). A quaternion
    becomes (q_y, -q_z, -q_x, q_w). Unity's ROS-TCP-Connector converts in this way, too (FLU to RUF). A heading of 0,
    along the world's x, looks along +z. Lines that begin with ``#`` state the axes and the costs.
    """
    seen = given.poses
    x, y, z = seen.positions.T
    qx, qy, qz, qw = seen.quaternions.T
    table = np.column_stack([seen.times, -y, z, x, qy, -qz, -qx, qw]) + 0.0  # no -0.0
    said = "".join(f"# {line}\n" for line in given.statement(UNITY_AXES))
    return (said + "t,x,y,z,qx,qy,qz,qw\n" + rows_of_text(table, ",")).encode()


UNREAL_AXES = (
    "left-handed, x ahead at heading 0, y right, z up (Unreal), cm; "
    "pitch up, yaw clockwise from above, roll to the right, degrees; t in s from the start"
)


@export_format("unreal-csv", suffix=".unreal.csv", axes=UNREAL_AXES)
def unreal_csv(given: Exported) -> bytes:
    """Return a table for Unreal Engine: left-handed, x along the world's x, y to its right, z up, cm.

    Columns are ``t`` (s, from the start), ``x``, ``y``, ``z`` (cm), and ``pitch``, ``yaw``, ``roll`` (degrees). Angles
    are those of an FRotator: pitch up, yaw clockwise from above, roll to the right. A point (x, y, z) of the world, in
    m, becomes (100 x, -100 y, 100 z). Yaw changes its sign. It does not jump at a full turn, so it may exceed 180.
    Lines that begin with ``#`` state the axes and the costs.
    """
    seen = given.poses
    angles = [pitch_of(seen.quaternions), -seen.yaws, roll_of(seen.quaternions)]
    table = np.column_stack([seen.times, seen.positions * [100.0, -100.0, 100.0], np.degrees(angles).T]) + 0.0
    said = "".join(f"# {line}\n" for line in given.statement(UNREAL_AXES))
    return (said + "t,x,y,z,pitch,yaw,roll\n" + rows_of_text(table, ",")).encode()
