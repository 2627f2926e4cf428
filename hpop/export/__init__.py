"""Trajectories for other programs: pose streams, Unity, Unreal, TUM, EuRoC, ROS 2, Nav2, glTF.

``hpop.export.write(trajectory, "cam.tum")`` writes one by the ending of the name, ``hpop.export.save(problem, front,
folder, rows=["knee"], formats=["tum", "mcap"])`` rows of a front. A format of your own is a function with
:func:`export_format` above it, or an entry point of the group ``hpop.formats``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import on_first_use
from hpop.export.base import Content, Exported, Frames, export_format

if TYPE_CHECKING:
    from hpop.export.glb import glb
    from hpop.export.poses import euroc, pose_csv, pose_json, tum, unity_csv, unreal_csv
    from hpop.export.ros import bag, mcap, nav2_yaml
    from hpop.export.writing import save, write

_HOMES = {
    "bag": "hpop.export.ros",
    "euroc": "hpop.export.poses",
    "glb": "hpop.export.glb",
    "mcap": "hpop.export.ros",
    "nav2_yaml": "hpop.export.ros",
    "pose_csv": "hpop.export.poses",
    "pose_json": "hpop.export.poses",
    "save": "hpop.export.writing",
    "tum": "hpop.export.poses",
    "unity_csv": "hpop.export.poses",
    "unreal_csv": "hpop.export.poses",
    "write": "hpop.export.writing",
}

__all__ = [
    "Content",
    "Exported",
    "Frames",
    "bag",
    "euroc",
    "export_format",
    "glb",
    "mcap",
    "nav2_yaml",
    "pose_csv",
    "pose_json",
    "save",
    "tum",
    "unity_csv",
    "unreal_csv",
    "write",
]

__getattr__ = on_first_use(__name__, _HOMES)
