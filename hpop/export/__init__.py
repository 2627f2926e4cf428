"""Export of trajectories to other programs: pose streams, joints, Unity, Unreal, TUM, EuRoC, ROS 2, Nav2, glTF.

``hpop.export.write(trajectory, "cam.tum")`` writes one trajectory in the format that the file's ending selects.
``hpop.export.save(problem, front, folder, rows=["knee"], formats=["tum", "mcap"])`` writes rows of a front. To add a
format of your own, decorate a function with :func:`export_format`, or declare an entry point of the group
``hpop.formats``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use
from hpop.export.base import Content, Exported, Frames, export_format

if TYPE_CHECKING:
    from hpop.export.glb import glb as glb
    from hpop.export.ros import bag as bag
    from hpop.export.ros import mcap as mcap
    from hpop.export.ros import nav2_yaml as nav2_yaml
    from hpop.export.streams import euroc as euroc
    from hpop.export.streams import follow_joint_trajectory as follow_joint_trajectory
    from hpop.export.streams import joint_trajectory as joint_trajectory
    from hpop.export.streams import moveit as moveit
    from hpop.export.streams import pose_csv as pose_csv
    from hpop.export.streams import pose_json as pose_json
    from hpop.export.streams import tum as tum
    from hpop.export.streams import unity_csv as unity_csv
    from hpop.export.streams import unreal_csv as unreal_csv
    from hpop.export.writing import save as save
    from hpop.export.writing import write as write

_HOMES = homes_of(__name__)
__all__ = [*_HOMES, "Content", "Exported", "Frames", "export_format"]
__getattr__ = on_first_use(__name__, _HOMES)
