"""Two arms for tests, and their poses and shapes by pinocchio and coal, as an independent oracle."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

import hpop
from hpop.world import Box, Solid, World, pose_at
from tests.models.serial_arm.arms import HERE, IN_HAND, arm6

TABLE = World.from_solids([Solid(Box((1.0, 2.4, 0.04)), pose_at((0.2, 0.5, -0.03)), "table")])
BESIDE = (0.1, 0.7, 0.0, 0.0, 0.0, -0.4)  # base of the viewing arm
SWEEP = {"times": [0.0, 0.8, 2.0], "joints": [[-0.6, 0.3, 1.4], [0.0, 0.6, 1.2], [0.8, 0.2, 1.5]]}


def sweep(rows: Any = SWEEP["joints"], times: Any = SWEEP["times"]) -> dict[str, Any]:
    """Return a motion of the example's arm whose first three joints are given."""
    columns = np.zeros((len(rows), 6))
    columns[:, :3] = rows
    return {"times": list(times), "joints": dict(zip(arm6().joints, columns.T.tolist(), strict=True))}


def two_arms(**parameters: Any) -> hpop.TwoArms:
    """Return two of the example's arms side by side, of which one sweeps over the table."""
    return hpop.TwoArms(**{"work": arm6(), "view": arm6(base=BESIDE), "motion": sweep(), "step": 0.25} | parameters)


def placed(x: float, y: float, z: float, roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return a pose (4, 4) from a position and angles, as a URDF means them."""
    (a, b), (c, d), (e, f) = ((np.cos(angle), np.sin(angle)) for angle in (roll, pitch, yaw))
    pose = np.eye(4)
    pose[:3, :3] = (
        np.array([[e, -f, 0], [f, e, 0], [0, 0, 1]])
        @ np.array([[c, 0, d], [0, 1, 0], [-d, 0, c]])
        @ np.array([[1, 0, 0], [0, a, -b], [0, b, a]])
    )
    pose[:3, 3] = x, y, z
    return pose


@cache
def _pinocchio() -> Any:
    import pinocchio

    model = pinocchio.buildModelFromUrdf(str(HERE / "arm6.urdf"))
    shapes = pinocchio.buildGeomFromUrdf(model, str(HERE / "arm6.urdf"), pinocchio.GeometryType.COLLISION)
    return pinocchio, model, model.createData(), shapes


def tool_at(joints: Any, base: Any = (0.0,) * 6) -> np.ndarray:
    """Return the pose (4, 4) of the tool of the example's arm, from pinocchio."""
    pinocchio, model, data, _ = _pinocchio()
    pinocchio.framesForwardKinematics(model, data, np.array(joints, float))
    return placed(*base) @ data.oMf[model.getFrameId("tool")].homogeneous


def camera_at(joints: Any, base: Any = BESIDE) -> np.ndarray:
    """Return the pose (4, 4) of the camera in the hand of the viewing arm."""
    return tool_at(joints, base) @ placed(*IN_HAND)


def shapes_at(joints: Any, base: Any = (0.0,) * 6) -> list[tuple[Any, Any]]:
    """Return the collision shapes of the example's arm with their poses, as coal and pinocchio have them."""
    pinocchio, model, data, shapes = _pinocchio()
    placements = shapes.createData()
    pinocchio.updateGeometryPlacements(model, data, shapes, placements, np.array(joints, float))
    there = pinocchio.SE3(placed(*base))
    return [(each.geometry, there * at) for each, at in zip(shapes.geometryObjects, placements.oMg, strict=True)]


def share_done(way: np.ndarray, speed: np.ndarray, acceleration: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the share of a motion from rest to rest at shares u of its time, and the least time of its joints."""
    least = max(1.5 * np.max(np.abs(way) / speed), np.sqrt(6.0 * np.max(np.abs(way) / acceleration)))
    return u * u * (3.0 - 2.0 * u), float(least)
