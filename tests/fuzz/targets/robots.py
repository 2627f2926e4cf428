"""Robots from files."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import trimesh
from mutations import Rng, bent_bytes, hostile
from verdicts import verdict

import hpop

ARM = Path(__file__).resolve().parents[3] / "examples/arm"
MESH = '<mesh filename="hand.stl" scale="0.001 0.001 0.001"/>'
TETRAHEDRON = b"OFF\n4 4 0\n0 0 0\n90 0 0\n0 90 0\n0 0 90\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
ATTRIBUTE = re.compile(r'(?<==")[^"]*(?=")')


def arm(rng: Rng, folder: Path) -> str:
    """Build, describe and pose an arm of a URDF and SRDF with bent bytes or attributes, at times a bent mesh."""
    kind = ("stl", "obj", "ply", "off")[rng.integers(4)]
    for name in ("arm6.urdf", "arm6.srdf"):
        text = (ARM / name).read_text()
        if name.endswith("urdf"):
            text = text.replace('<box size="0.06 0.1 0.05"/>', MESH.replace("stl", kind))
        (folder / name).write_bytes(_bent_xml(text, rng))
    mesh = trimesh.load(io.BytesIO(TETRAHEDRON), file_type="off").export(file_type=kind)
    data = mesh if isinstance(mesh, bytes) else mesh.encode()
    (folder / f"hand.{kind}").write_bytes(bent_bytes(data, rng) if rng.random() < 0.3 else data)

    def made() -> None:
        found = hpop.SerialArm(folder / "arm6.urdf", "tool", 6.0, srdf=folder / "arm6.srdf")
        json.dumps(found.describe(), allow_nan=False)
        repr(found.pose("camera", found.space.sample(rng, 3)).x)

    return verdict(made)


def _bent_xml(text: str, rng: Rng) -> bytes:
    """XML as it is, with bent bytes, or with hostile values in the place of some attributes."""
    way = rng.random()
    if way < 0.2:
        return text.encode()
    if way < 0.6:
        return bent_bytes(text.encode(), rng)
    places = list(ATTRIBUTE.finditer(text))
    for place in sorted(rng.choice(len(places), int(rng.integers(1, 4)), replace=False), reverse=True):
        begin, end = places[place].span()
        value = str(hostile(rng)) if rng.random() < 0.7 else places[rng.integers(len(places))].group()
        text = text[:begin] + value.replace('"', "").replace("<", "").replace("&", "") + text[end:]
    return text.encode("utf-8", "surrogatepass")
