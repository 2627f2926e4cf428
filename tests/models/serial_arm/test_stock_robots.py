"""Robots as their makers describe them, of the wheels example-robot-data and robot_descriptions: they load and plan."""

import importlib
import importlib.metadata
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import hpop
from hpop.models import SerialArm
from hpop.models.serial_arm.meshes import mesh_path
from hpop.models.serial_arm.urdf import UrdfMesh, read_urdf
from hpop.motions import States
from hpop.problems.verify import verify
from hpop.world import Box, Solid, World, pose_at

trimesh = pytest.importorskip("trimesh")

ROBOTS = {
    "UR5": ("ur_description/urdf/ur5_robot.urdf", "tool0", "ur5_description"),
    "UR10": ("ur_description/urdf/ur10_robot.urdf", "tool0", "ur10_description"),
    "UR10e": ("", "tool0", "ur10e_description"),
    "xArm7": ("xarm_description/urdf/xarm7.urdf", "link7", "xarm7_description"),
    "Kinova Jaco": ("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector", "j2s6s200_description"),
    "Kinova Gen3": ("", "end_effector_link", "gen3_description"),
    "Kinova Gen3 lite": ("", "end_effector_link", "gen3_lite_description"),
    "SO-100": ("so_arm_description/urdf/so100.urdf", "gripper", "so_arm100_description"),
    "SO-101": ("so_arm_description/urdf/so101.urdf", "gripper_link", "so_arm101_description"),
    "TIAGo": ("tiago_description/robots/tiago.urdf", "arm_tool_link", "tiago_description"),
    "Z1": ("z1_description/urdf/z1.urdf", "link06", "z1_description"),
    "Fetch": ("", "gripper_link", "fetch_description"),
    "Panda": ("panda_description/urdf/panda.urdf", "panda_hand", "panda_description"),
}


def in_wheel(place: str) -> Path | None:
    """Return a file of example-robot-data, or None if the wheel is not installed or has no such file."""
    with suppress(importlib.metadata.PackageNotFoundError):
        for file in (importlib.metadata.files("example-robot-data") or []) if place else []:
            if str(file).endswith(place):
                return Path(str(file.locate())).resolve()
    return None


def found(name: str) -> tuple[Path, str, dict[str, Path]]:
    """Return URDF, tip and packages of a robot; the test is skipped with the reason where there are none."""
    place, tip, module = ROBOTS[name]
    if (path := in_wheel(place)) is not None:
        return path, tip, {"example-robot-data": path.parents[3]}
    try:  # fetches from the network, which tests do not have everywhere
        described = importlib.import_module(f"robot_descriptions.{module}")
        urdf = Path(described.URDF_PATH)  # some have a xacro file only
    except Exception as error:
        pytest.skip(f"{name}: not in example-robot-data, and robot_descriptions has none: {type(error).__name__}")
    packages = {Path(described.PACKAGE_PATH).name: Path(described.PACKAGE_PATH)}
    return urdf, tip, packages


@pytest.mark.proof
@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_loads_its_hulls_hold_its_meshes_and_it_plans(name):
    if name in ("Kinova Jaco", "TIAGo"):
        pytest.importorskip("collada")
    path, tip, packages = found(name)
    arm = SerialArm.from_urdf(path, tip=tip, acceleration=3.0, packages=packages)
    assert arm.parts
    robot, parts = read_urdf(path), [*arm.parts]
    for geometries in robot.links.values():
        for geometry in geometries:
            if not isinstance(geometry.shape, UrdfMesh):
                parts.pop(0)
                continue
            mesh = trimesh.load(mesh_path(geometry.shape, path.parent, packages), force="mesh")
            points = np.concatenate([mesh.vertices[mesh.faces].reshape(-1, 3), mesh.triangles_center])
            inside = np.zeros(len(points), bool)
            while parts and not inside.all():
                hull = trimesh.Trimesh(parts.pop(0).solid.shape.points).convex_hull
                origins, normals = hull.triangles[:, 0], hull.face_normals
                offsets = np.einsum("fi,fi->f", origins, normals)
                for some in np.array_split(np.arange(len(points)), 1 + len(points) // 2000):
                    inside[some] |= ((points[some] * geometry.shape.scale) @ normals.T <= offsets + 1e-6).all(axis=1)
            assert inside.all(), geometry.shape.name
    assert not parts

    rng = np.random.default_rng(0)
    reach = np.linalg.norm(arm.chain.origins[1:, :3, 3], axis=1).sum()
    box = Solid(Box((0.2 * reach, 0.2 * reach, 0.1 * reach)), pose_at((0.7 * reach, 0.0, 0.3 * reach)), "box")
    world = World.from_solids([box])
    rows = rng.uniform(arm.chain.low, arm.chain.high, (4000, len(arm.chain)))
    free = rows[arm.collision(world).states_free(States(**dict(zip(arm.joints, rows.T, strict=True))))]
    assert len(free) >= 2, arm.collision(world).why_blocked(arm.space.state(tuple(rows[0])))
    near = free[np.argsort(np.linalg.norm(free - free[0], axis=1))[1]]
    problem = hpop.Problem(world, arm, tuple(free[0]), tuple(near), ["duration", "rotation"])
    front = problem.solve("roadmap", samples=100)
    assert len(front)
    assert verify(problem, front) == []
