"""Where the camera looks along a trajectory: wedges on the map, a few of them."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.patches import Patch, Wedge

from hpop.arrays import FloatArray
from hpop.math import wrap
from hpop.motions import Model
from hpop.trajectory import Trajectory
from hpop.view.ground import View
from hpop.view.style import QUIET

REACH = 0.045  # of the longer side of a map: how far a wedge reaches
APART = 1.5  # reaches: from one wedge to the next, along the way
POINTER = math.radians(16.0)  # how wide the wedge of a camera is that sees all round
SAMPLES = 4000  # moments at which a trajectory is looked at
ASIDE = 1e-6  # rad: a camera that looks no farther aside of the base looks where it does


def looks_aside(model: Model, trajectories: list[Trajectory]) -> bool:
    """Whether pictures must say where a camera looks: it sees a part only, or does not look where the base does."""
    if "camera" not in model.provides:
        return False
    if "base" not in model.provides or getattr(model, "field_of_view", None) is not None:
        return True
    poses = ((model.pose("camera", t.states), model.pose("base", t.states)) for t in trajectories)
    return any((np.abs(wrap(camera.yaw - base.yaw)) > ASIDE).any() or camera.pitch.any() for camera, base in poses)


def draw_sight(axes: Axes, trajectory: Trajectory, colour: str, view: View, *, zorder: float, gid: str) -> None:
    """Draw a wedge at the start, at even distances on the way, and at the goal; one that looks up or down is shorter.

    Where the robot stands, it is the view with which it goes on.
    """
    reach = REACH * max(view.width, view.height)
    pose = trajectory.model.pose("camera", trajectory.at(_moments(trajectory, APART * reach)))
    half = math.degrees(0.5 * _width(trajectory.model))
    wedges = [
        Wedge((x, y), reach * abs(math.cos(pitch)), math.degrees(yaw) - half, math.degrees(yaw) + half)
        for x, y, yaw, pitch in zip(pose.x, pose.y, pose.yaw, pose.pitch, strict=True)
    ]
    drawn = PatchCollection(wedges, facecolors=[(colour, 0.22)], edgecolors=[(colour, 0.8)], linewidths=0.5)
    drawn.set(zorder=zorder, gid=gid)
    axes.add_collection(drawn, autolim=False)


def sight_entry(model: Model) -> Patch:
    """The legend entry for such wedges."""
    given = getattr(model, "field_of_view", None)
    width = "" if given is None else f", {math.degrees(given[0]):.0f}° wide"
    return Patch(facecolor=(QUIET, 0.22), edgecolor=(QUIET, 0.8), linewidth=0.5, label=f"where the camera looks{width}")


def _width(model: Model) -> float:
    """How wide a wedge is, rad."""
    given = getattr(model, "field_of_view", None)
    return POINTER if given is None or given[0] >= 2.0 * math.pi else float(given[0])


def _moments(trajectory: Trajectory, apart: float) -> FloatArray:
    """Times (N,), s, at which the camera has gone on by a distance, m; the end is one of them."""
    times = np.linspace(0.0, trajectory.duration, SAMPLES)
    pose = trajectory.model.pose("camera", trajectory.at(times))
    gone = np.append(0.0, np.cumsum(np.hypot(np.diff(pose.x), np.diff(pose.y))))
    number = max(1, round(float(gone[-1]) / apart))
    at = np.searchsorted(gone, np.linspace(0.0, gone[-1], number + 1)[:-1], side="right")
    return np.append(times[np.minimum(at, SAMPLES - 1)], trajectory.duration)
