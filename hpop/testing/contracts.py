"""What plugins may leave out: whether that which they say of it is as their protocols have it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, get_args

import numpy as np

from hpop.base.registry import criteria
from hpop.base.text import shown
from hpop.criteria.base import Aggregate, Criterion, Group, Role
from hpop.errors import ModelError
from hpop.models.camera import checked_field_of_view
from hpop.models.collision.parts import Part
from hpop.motions import Model, Motions, States, collision_of
from hpop.testing.checks import SAME, differ
from hpop.world import World

WHEELS = ("wheel_base", "wheel_speed", "wheel_acceleration")
RIGID = ("speed", "acceleration", "turn_rate", "turn_acceleration")


def model_says(model: Model, world: World, states: States) -> str:
    """What is wrong with the optional attributes of a model, asked in states (N,); "" where nothing is."""
    if not (isinstance(model.name, str) and model.name):
        return f"name is a word, got {shown(model.name)}"
    try:
        checked_field_of_view(model.field_of_view)
    except ModelError as error:
        return str(error)
    if not (isinstance(model.notes, tuple) and all(isinstance(note, str) for note in model.notes)):
        return f"notes is a tuple of sentences, got {shown(model.notes)}"
    return (
        _joints(model)
        or _executed(model)
        or _wheels(model)
        or _platform(model, states)
        or _bodies(model, states)
        or _measures(model, world, states)
    )


def _joints(model: Model) -> str:
    joints = model.joints
    if not isinstance(joints, tuple) or not set(joints) <= set(model.space.names) - {"x", "y", "yaw"}:
        return f"joints is a tuple of states besides x, y and yaw, got {shown(joints)}"
    if bool(joints) != ("joints" in model.provides):
        return f"joints names {', '.join(joints) or 'none'}, but provides {'has no' if joints else 'has'} 'joints'"
    return ""


def _executed(model: Model) -> str:
    executed, kinds = model.executed, set(model.laws)
    if not isinstance(executed, Mapping):
        return f"executed maps kinds of laws to kinds, got {shown(executed)}"
    for planned, done in executed.items():
        if planned in kinds and done not in kinds:
            return f"executed does a {planned} by {done!r}, but the laws are {', '.join(sorted(kinds))}"
    return ""


def _wheels(model: Any) -> str:
    if "wheels" not in model.provides:
        return ""
    curves = "rigid" in model.provides
    for name in (*WHEELS, *(RIGID if curves else ())):
        value = getattr(model, name, None)
        if not (isinstance(value, int | float) and 0.0 < value < math.inf):
            return f"wheels, but its {name} is {shown(value)}, no positive number (hpop.motions.Wheeled)"
    if curves and "drive" not in model.laws:
        return f"wheels and rigid, but it has no law 'drive' for curves; its laws are {', '.join(model.laws)}"
    return ""


def _platform(model: Model, states: States) -> str:
    """Upright prisms, in which the parts of a model in the plane are wherever its joints are."""
    strange = [part for part in model.platform if not isinstance(part, Part) or part.on]
    if strange:
        return f"platform holds parts without joints (hpop.models.base.Part), got {shown(strange[0])}"
    if "plane" not in model.provides:
        return ""
    if not model.platform:
        return "plane, but its platform is empty"
    reach, top = max(part.reach for part in model.platform), max(part.z_max for part in model.platform)
    for part in model.parts:
        corners = part.placed(states) - np.stack([states.x, states.y], axis=1)[:, None]
        farthest = float(np.hypot(*corners.transpose(2, 0, 1)).max()) + part.radius
        if farthest > reach + SAME:
            return f"a part reaches {farthest:.6g} m from the axis, its platform {reach:.6g} m"
        if (highest := part.z_max + float(part.lift(states).max())) > top + SAME:
            return f"a part comes up to {highest:.6g} m, its platform to {top:.6g} m"
    return ""


def _bodies(model: Model, states: States) -> str:
    for shape, poses in model.bodies(states):
        if not hasattr(shape, "corners") and not hasattr(shape, "radius"):
            return f"bodies are shapes of hpop.world.geometry.solids with poses, got {shown(shape)}"
        if np.shape(poses) not in ((4, 4), (1, 4, 4), (states.size, 4, 4)):
            return f"the poses of a body have the shape {np.shape(poses)}, for {states.size} states (N, 4, 4)"
        if not np.isfinite(poses).all():
            return "a pose of a body is no number"
    return ""


def _measures(model: Model, world: World, states: States) -> str:
    """What a collision says beside which states are free."""
    collision = collision_of(model, world)
    if (clearance := collision.clearance) is not None:
        found = np.asarray(clearance(states))
        if found.shape != (states.size,) or not (found >= 0.0).all():
            return f"clearance of its collision is a distance >= 0 a state, got {shown(found.tolist())}"
    if "plane" not in model.provides or collision.posture_matters or not model.joints:
        return ""
    other = States(**states.__dict__ | {name: getattr(states, name)[::-1] for name in model.joints})
    if (collision.states_free(states) != collision.states_free(other)).any():
        return "its collision depends on joints, but its posture_matters is False"
    return ""


def law_says(motions: Motions) -> str:
    """What is wrong with the optional attributes of a law, shown on some of its motions."""
    law = motions.law
    extra = law.extra
    if not isinstance(extra, tuple) or not all(isinstance(name, str) for name in extra):
        return f"extra of a {law.kind} is a tuple of names of states, got {shown(extra)}"
    if law.quadrature not in (None, "adaptive"):
        return f"quadrature of a {law.kind} is 'adaptive' or None, got {shown(law.quadrature)}"
    if not law.reversible:
        return ""
    there, back = law.phases(motions.start, motions.end), law.phases(motions.end, motions.start)
    lasts, again = (sum(phase.duration for phase in phases) for phases in (there, back))
    if fault := differ(f"duration of a {law.kind}, which is reversible, back", lasts, again, SAME, 1.0):
        return fault
    share = np.full(len(motions), 0.3)
    for name in law.varies:
        onward = law.interpolate(name, motions.start, motions.end, share)
        other = law.interpolate(name, motions.end, motions.start, 1.0 - share)
        if fault := differ(f"{name} of a {law.kind}, which is reversible, on the way back", onward, other, 1e-6, 1.0):
            return fault
    return ""


def criterion_says(criterion: Criterion) -> str:
    """What is wrong with what a criterion declares; "" where nothing is."""
    choices = {
        "group": (criterion.group, get_args(Group)),
        "aggregate": (criterion.aggregate, get_args(Aggregate)),
        "role": (criterion.role, (None, *get_args(Role))),
        "smooth": (criterion.smooth, (True, False)),
        "world_frame": (criterion.world_frame, (True, False)),
    }
    for name, (value, allowed) in choices.items():
        if value not in allowed:
            return f"{name} is one of {', '.join(map(str, allowed))}, got {shown(value)}"
    for name in ("name", "unit"):
        if not (isinstance(value := getattr(criterion, name), str) and value.strip()):
            return f"{name} is a word, got {shown(value)}"
    for name in ("requires", "instead"):
        value = getattr(criterion, name)
        if not isinstance(value, tuple) or not all(isinstance(one, str) for one in value):
            return f"{name} is a tuple of names, such as ('camera',), got {shown(value)}"
    if strange := [name for name in criterion.instead if name not in criteria]:
        return f"instead names {', '.join(strange)}, which is no criterion"
    if not (isinstance(criterion.quantum, int | float) and 0.0 < criterion.quantum < math.inf):
        return f"quantum is a positive number, got {shown(criterion.quantum)}"
    for name in ("bound", "convex"):
        if not (getattr(criterion, name) is None or callable(getattr(criterion, name))):
            return f"{name} is a method or None, got {shown(getattr(criterion, name))}"
    return _integral(criterion)


def _integral(criterion: Criterion) -> str:
    integral = criterion.integral
    if integral is None:
        return ""
    if criterion.aggregate != "time-mean":
        return f"integral stands in for a time-mean, and this is a {criterion.aggregate}"
    if not isinstance(integral, Criterion) or integral.aggregate != "sum":
        return f"integral is a criterion that is a sum, got {shown(integral)}"
    return ""
