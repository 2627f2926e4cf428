"""Poses as one JSON object, in the world's frame."""

from __future__ import annotations

from hpop.export.base import PROGRAM, Exported, export_format
from hpop.frontier import strict_json

AXES = (
    "right-handed, x and y on the floor, z up (REP-103), m; quaternions x, y, z, w of the body (x ahead, y left); "
    "speeds m/s forward, yaws rad and yaw_rates rad/s counter-clockwise; times in s from the start"
)


@export_format("json", suffix=".json", axes=AXES)
def pose_json(given: Exported) -> bytes:
    """One JSON object of poses, in the world's frame, with its costs: for web pages and scripts.

    ``times`` (s, from the start), ``positions`` [x, y, z] (m), ``quaternions`` [x, y, z, w] (unit; they turn the
    world's axes to those of the body: x ahead, y left, z up), ``yaws`` (rad, continuous), ``speeds`` (m/s, along the
    direction ahead), ``yaw_rates`` (rad/s), a row a pose; ``axes`` says so. Right-handed, z up (REP-103). Strict JSON
    of UTF-8; numbers read back as the same float64.
    """
    seen = given.poses
    told = {
        "schema": "hpop-poses",
        "version": 1,
        "program": PROGRAM,
        "axes": AXES,
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
