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
    from hpop.export.formats.bag import bag
    from hpop.export.formats.euroc import euroc
    from hpop.export.formats.glb import glb
    from hpop.export.formats.mcap import mcap
    from hpop.export.formats.nav2 import nav2_yaml
    from hpop.export.formats.pose_csv import pose_csv
    from hpop.export.formats.pose_json import pose_json
    from hpop.export.formats.tum import tum
    from hpop.export.formats.unity import unity_csv
    from hpop.export.formats.unreal import unreal_csv
    from hpop.export.writing import save, write

_HOMES = {
    "bag": "hpop.export.formats.bag",
    "euroc": "hpop.export.formats.euroc",
    "glb": "hpop.export.formats.glb",
    "mcap": "hpop.export.formats.mcap",
    "nav2_yaml": "hpop.export.formats.nav2",
    "pose_csv": "hpop.export.formats.pose_csv",
    "pose_json": "hpop.export.formats.pose_json",
    "save": "hpop.export.writing",
    "tum": "hpop.export.formats.tum",
    "unity_csv": "hpop.export.formats.unity",
    "unreal_csv": "hpop.export.formats.unreal",
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
