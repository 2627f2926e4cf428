"""Arms of the tests: the example's, and one whose joints turn without limits and slide."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from hpop.models import SerialArm

HERE = Path(__file__).resolve().parents[3] / "examples/arm"
QUARTER = 0.5 * math.pi
IN_HAND = (-0.06, 0.0, -0.08, 0.0, -QUARTER, 0.0)

CRANE = """<robot name="crane">
  <link name="rail"/>
  <link name="mast"><collision><geometry><cylinder radius="0.05" length="0.6"/></geometry></collision></link>
  <link name="boom">
    <collision><origin xyz="0.2 0 0"/><geometry><box size="0.3 0.06 0.06"/></geometry></collision>
  </link>
  <link name="jib"><collision><origin xyz="0.1 0 0"/><geometry><sphere radius="0.03"/></geometry></collision></link>
  <link name="eye"/>
  <link name="lamp"/>
  <joint name="lift" type="prismatic">
    <parent link="rail"/><child link="mast"/><origin xyz="0.1 -0.2 0.5" rpy="0.1 -0.2 0.3"/><axis xyz="0 0.6 0.8"/>
    <limit lower="-0.2" upper="0.7" velocity="0.5" effort="9"/>
  </joint>
  <joint name="swing" type="continuous">
    <parent link="mast"/><child link="boom"/><origin xyz="0 0 0.35"/><axis xyz="0 0 1"/>
    <limit velocity="1.5" effort="9"/>
  </joint>
  <joint name="out" type="prismatic">
    <parent link="boom"/><child link="jib"/><origin xyz="0.4 0 0" rpy="0.4 0 0"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.3" velocity="0.4" effort="9"/>
  </joint>
  <joint name="tilt" type="revolute">
    <parent link="jib"/><child link="eye"/><origin xyz="0.2 0.01 -0.03" rpy="0 0 0.7"/><axis xyz="1 2 -0.5"/>
    <limit lower="-1.5" upper="2" velocity="2" effort="9"/>
  </joint>
  <joint name="wick" type="revolute">
    <parent link="jib"/><child link="lamp"/><axis xyz="0 1 0"/><limit lower="0.2" upper="1" velocity="2" effort="9"/>
  </joint>
</robot>
"""


def arm6(**parameters: Any) -> SerialArm:
    """Return the example's arm, with its camera beside its fingers."""
    given: dict[str, Any] = {"tip": "tool", "srdf": HERE / "arm6.srdf", "acceleration": 6.0, "camera": IN_HAND}
    return SerialArm.from_urdf(HERE / "arm6.urdf", **given | parameters)


def crane(folder: Path, **parameters: Any) -> SerialArm:
    """Return an arm of a lift, a swing without end stops, a slide and a tilt about a slanting axis."""
    path = folder / "crane.urdf"
    path.write_text(CRANE)
    return SerialArm.from_urdf(path, **{"tip": "eye", "acceleration": 2.0} | parameters)
