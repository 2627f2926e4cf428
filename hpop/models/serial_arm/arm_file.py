"""An arm from its files: URDF, SRDF and meshes, read once, with the hashes by which a saved front knows them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.text import shown
from hpop.errors import ModelError
from hpop.models.serial_arm.assembly import assembled, parts_of, touching
from hpop.models.serial_arm.chain import Chain, Mount, Part
from hpop.models.serial_arm.doubts import pointless, strangers, uncovered, undriven
from hpop.models.serial_arm.meshes import found_mesh, hulls, mesh_bytes
from hpop.models.serial_arm.srdf import Pair, Semantics, read_srdf
from hpop.models.serial_arm.urdf import Mesh, read_urdf
from hpop.world.files import sha256
from hpop.world.geometry.solids import Hull

Values = tuple[float, ...]


class ArmFile(NamedTuple):
    """What the files of an arm say.

    chain    with the bodies "tool" and "camera"
    parts    its solids
    apart    pairs of links whose collisions are not looked at: they touch by design, or the SRDF says so
    notes    what is strange in the files, though they can be used
    states   values of the chain's joints by the name of a state
    unnamed  why another name of the SRDF is none of these; under "" why any other is not
    hashes   SHA-256 of the URDF and of its meshes in the order in which it names them, and of the SRDF if there is one
    """

    chain: Chain
    parts: tuple[Part, ...]
    apart: frozenset[Pair]
    notes: tuple[str, ...]
    states: Mapping[str, Values]
    unnamed: Mapping[str, str]
    hashes: tuple[str, ...]
    srdf_hash: str | None


def read_arm(
    urdf: str,
    srdf: str | None,
    *,
    packages: Mapping[str, str],
    tip: str,
    camera: FloatArray,
    base: FloatArray,
    fixed: Mapping[str, float],
    acceleration: float | Mapping[str, float],
) -> ArmFile:
    """The arm whose root has the pose ``base`` (4, 4) in the world and whose camera has ``camera`` (4, 4) on the tip.

    Raises ModelError for what is no arm, and for files that are missing or not to be trusted.
    """
    robot = read_urdf(urdf)
    assembly = assembled(robot, tip, base, fixed, acceleration)
    hashes = {robot.file.path: sha256(robot.file.data)}
    pieces: dict[tuple[Path, tuple[float, ...]], list[Hull]] = {}

    def mesh_hulls(mesh: Mesh) -> list[Hull]:
        try:
            path = found_mesh(mesh, robot.file.path.parent, packages)
            key = (path, tuple(mesh.scale.tolist()))
            if key not in pieces:
                data = mesh_bytes(path)
                hashes[path] = sha256(data)
                pieces[key] = hulls(data, path, mesh.scale)
        except ModelError as error:
            raise robot.file.error(f"the collision geometry of link {shown(mesh.link)}: {error}") from None
        return pieces[key]

    parts = tuple(parts_of(robot, assembly.places, mesh_hulls))
    tool = assembly.chain.mounts["tool"]
    mounts = {"tool": tool, "camera": Mount(tool.frame, tool.pose @ camera)}
    chain = replace(assembly.chain, mounts=mounts)
    apart, semantics = touching(robot, assembly.places), None if srdf is None else read_srdf(srdf)
    if semantics is not None:
        solid = [link for link, shapes in robot.links.items() if shapes]
        apart |= semantics.apart(solid)
    notes = (*uncovered(robot), *pointless(robot))
    if semantics is not None:
        notes = (*notes, *strangers(robot, semantics), *undriven(chain.names, semantics))
    states = {} if semantics is None else _states(chain, semantics)
    unnamed = {"": NO_SRDF} if semantics is None else _unnamed(chain, semantics)
    srdf_hash = None if semantics is None else sha256(semantics.file.data)
    return ArmFile(chain, parts, apart, notes, states, unnamed, tuple(hashes.values()), srdf_hash)


def _states(chain: Chain, semantics: Semantics) -> dict[str, Values]:
    """Named states that give every joint of the chain; what is half a thousandth beyond a limit is meant to be at it.

    Other states beyond limits are refused when they are asked for: MoveIt's own SRDF of the Panda has one.
    """
    found = {}
    for name, values in semantics.states.items():
        if values.keys() >= set(chain.names):
            given = np.array([values[joint] for joint in chain.names])
            within = np.clip(given, chain.low, chain.high)
            meant = ~chain.turning & (np.abs(given - within) <= ROUNDED)
            found[name] = tuple(np.where(meant, within, given).tolist())
    return found


def _unnamed(chain: Chain, semantics: Semantics) -> dict[str, str]:
    """What states of an SRDF that are none of the chain lack, in words."""
    lacking = {
        name: ", ".join(joint for joint in chain.names if joint not in values)
        for name, values in semantics.states.items()
    }
    return {name: f"the SRDF's state of this name lacks {joints}" for name, joints in lacking.items() if joints}


NO_SRDF = "states have names in an SRDF, and none was given as srdf"
ROUNDED = 5e-4
"""rad or m by which a value in a file may pass a limit for lack of decimals: 1.5708 is meant for half of pi."""
