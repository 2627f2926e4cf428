"""Where the camera looks along a trajectory, at a few places: wedges on the map of a base, cones in any other view."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection, PolyCollection
from matplotlib.patches import Patch, Wedge

from hpop.base.arrays import FloatArray
from hpop.base.math import wrap
from hpop.models.camera import field_of_view
from hpop.motions import Model, Pose
from hpop.trajectories.trajectory import Trajectory
from hpop.view.ground import View
from hpop.view.paths import positions
from hpop.view.robot import Flatten, from_above
from hpop.view.style import QUIET

REACH = 0.045  # of the longer side of a map: how far a wedge reaches
APART = 1.5  # reaches: from one wedge to the next, along the way
CONE_REACH = 0.07  # as REACH, of a cone
CONES_APART = 3.0  # reaches
RIM = np.linspace(-1.0, 1.0, 9)  # shares of half an angle of view at which a cone's rim is sampled
AHEAD = 1 + RIM.size**2 // 2  # place of the middle of the view among the points of a cone
POINTER = math.radians(16.0)  # how wide the wedge of a camera is that sees all round
SAMPLES = 4000  # moments at which a trajectory is looked at
ASIDE = 1e-6  # rad: a camera that looks no farther aside of the base looks where it does


def looks_aside(model: Model, trajectories: list[Trajectory]) -> bool:
    """Whether pictures must say where a camera looks: it sees a part only, or does not look where the base does."""
    if "camera" not in model.provides:
        return False
    if "base" not in model.provides or model.field_of_view is not None:
        return True
    poses = ((model.pose("camera", t.states), model.pose("base", t.states)) for t in trajectories)
    return any((np.abs(wrap(camera.yaw - base.yaw)) > ASIDE).any() or camera.pitch.any() for camera, base in poses)


def draw_sight(axes: Axes, trajectory: Trajectory, colour: str, view: View, *, zorder: float, gid: str) -> None:
    """Draw where the camera looks from above: wedges on the ground of a base, cones of a camera in a hand.

    There is one at the start, at even distances on the way, and at the goal; a wedge that looks up or down is shorter.
    Where the robot stands, it is the view with which it goes on.
    """
    if "base" not in trajectory.model.provides:
        draw_cones(axes, trajectory, colour, view, from_above, zorder=zorder, gid=gid)
        return
    reach = REACH * max(view.width, view.height)
    pose = trajectory.model.pose("camera", trajectory.at(_moments(trajectory, APART * reach)))
    half = math.degrees(0.5 * _width(trajectory.model))
    wedges = [
        Wedge((x, y), reach * abs(math.cos(pitch)), math.degrees(yaw) - half, math.degrees(yaw) + half)
        for x, y, yaw, pitch in zip(pose.x, pose.y, pose.yaw, pose.pitch, strict=True)
    ]
    drawn = PatchCollection(wedges, **_look(colour))
    drawn.set(zorder=zorder, gid=gid)
    axes.add_collection(drawn, autolim=False)


def draw_cones(
    axes: Axes, trajectory: Trajectory, colour: str, view: View, flatten: Flatten, *, zorder: float, gid: str
) -> None:
    """Draw what the camera has in view up to a short distance, as it is seen from afar, at even distances on the way.

    flatten : points in space (..., 3) as they are in the picture (..., 2)
    """
    reach = CONE_REACH * max(view.width, view.height)
    pose = trajectory.model.pose("camera", trajectory.at(_moments(trajectory, CONES_APART * reach)))
    points = flatten(cone_points(trajectory.model, pose, reach))  # (N, 1 + K, 2)
    outlines = [shapely.get_coordinates(hull) for hull in shapely.convex_hull(shapely.multipoints(list(points)))]
    axes.add_collection(PolyCollection(outlines, zorder=zorder, gid=gid, **_look(colour)), autolim=False)
    rays = LineCollection(list(points[:, [0, AHEAD]]), colors=colour, linewidths=1.0, zorder=zorder + 0.05)
    axes.add_collection(rays, autolim=False)


def cone_points(model: Model, pose: Pose, reach: float) -> FloatArray:
    """Where the camera is, and points (N, 1 + K, 3), m, that it sees at one distance: all round, those ahead of it."""
    h, v = (angle if angle < math.pi else POINTER for angle in field_of_view(model))
    b, e = (grid.ravel() for grid in np.meshgrid(0.5 * h * RIM, 0.5 * v * RIM))
    level = np.cos(e)
    axes = (np.stack(np.broadcast_arrays(*vector, pose.x)[:3], axis=1) for vector in (pose.ahead, pose.left, pose.up))
    shares = (level * np.cos(b), level * np.sin(b), np.sin(e))  # (K,) each
    rays = sum(share[:, None] * axis[:, None, :] for share, axis in zip(shares, axes, strict=True))  # (N, K, 3)
    camera = positions(pose)[:, None, :]
    return np.concatenate([camera, camera + reach * rays], axis=1)


def sight_entry(model: Model, *, cones: bool) -> Patch:
    """The legend entry for wedges, or for cones."""
    given = model.field_of_view
    width, height = ("", "") if given is None else (f"{math.degrees(angle):.0f}°" for angle in given)
    said = f",\n{width} wide and {height} high" if cones else f", {width} wide"
    return Patch(**_look(QUIET), label="where the camera looks" + said * (given is not None))


def _look(colour: str) -> dict[str, Any]:
    return {"facecolor": (colour, 0.22), "edgecolor": (colour, 0.8), "linewidth": 0.5}


def _width(model: Model) -> float:
    """How wide a wedge is, rad."""
    given = model.field_of_view
    return POINTER if given is None or given[0] >= 2.0 * math.pi else float(given[0])


def _moments(trajectory: Trajectory, apart: float) -> FloatArray:
    """Times (N,), s, at which the camera has gone on by a distance, m; the end is one of them."""
    times = np.linspace(0.0, trajectory.duration, SAMPLES)
    steps = np.diff(positions(trajectory.model.pose("camera", trajectory.at(times))), axis=0)
    gone = np.append(0.0, np.cumsum(np.sqrt((steps**2).sum(axis=1))))
    number = max(1, round(float(gone[-1]) / apart))
    at = np.searchsorted(gone, np.linspace(0.0, gone[-1], number + 1)[:-1], side="right")
    return np.append(times[np.minimum(at, SAMPLES - 1)], trajectory.duration)
