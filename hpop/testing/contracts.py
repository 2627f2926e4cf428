"""Parts of the conformance checks: comparisons of attributes with their protocols, and of bodies with their poses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple, get_args

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.registry import criteria
from hpop.base.text import shown
from hpop.criteria.base import Aggregate, Criterion, Group, Role, class_of
from hpop.errors import HpopError, ModelError
from hpop.models.collision import Part
from hpop.models.rigid import checked_field_of_view
from hpop.motions import Body, Model, Motions, Pose, States, collision_of
from hpop.motions.states import Vector
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

SAME = 1e-9  # m or rad, and relative: tolerance of equal values
LEAST_SCALE = 1e-5  # least scale to which tolerances are relative
WHEELS = ("wheel_base", "wheel_speed", "wheel_acceleration")
RIGID = ("speed", "acceleration", "turn_rate", "turn_acceleration")
MOMENTS = 40  # within each motion
MOMENT = 1e-6  # s, step of finite differences
SAMPLES = 1000  # along a motion, to measure its path and rotation
TWIST_TOLERANCE = 1e-4  # relative, of finite differences
BODY_TOLERANCE = 5e-3  # relative: quadrature, and polygons in place of curves


class Check(NamedTuple):
    """Conformance check: a claim, and the fault that contradicts it ("" if there is none)."""

    claim: str
    fault: str


def raise_faults(what: str, checks: Iterable[Check], error: type[HpopError]) -> None:
    """Raise ``error`` with a list of all failed checks, if any check of ``what`` failed."""
    faults = [f"{check.claim}: {check.fault}" for check in checks if check.fault]
    if faults:
        raise error(f"{what} fails {len(faults)} check{'s' * (len(faults) > 1)}:\n  " + "\n  ".join(faults))


def fault_of(test: Callable[[], str]) -> str:
    """Return the fault that a test finds; an exception of the tested code counts as a fault."""
    try:
        return test()
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def differ(what: str, expected: FloatArray, found: FloatArray, tolerance: float, scale: float | None = None) -> str:
    """Return a message on the largest difference of two columns; "" if they agree.

    what       compared quantity, for the message
    tolerance  allowed difference, as a share of the expected value or of ``scale``, whichever is larger
    scale      by default, the largest expected value
    """
    gap = np.abs(expected - found)
    largest = float(np.abs(expected).max(initial=0.0)) if scale is None else scale
    allowed = tolerance * np.maximum(np.abs(expected), max(largest, LEAST_SCALE))
    if np.all(gap <= allowed):  # not a number is a fault
        return ""
    worst = int(np.argmax(np.where(np.isnan(gap), np.inf, gap - allowed)))
    return f"{what}: expected {expected.flat[worst]:.6g}, found {found.flat[worst]:.6g}"


def model_says(model: Model, world: World, states: States) -> str:
    """Return the first fault of the optional attributes of a model, in states (N,); "" if there is none."""
    if not (isinstance(model.name, str) and model.name):
        return f"name must be a text that is not empty, got {shown(model.name)}"
    try:
        checked_field_of_view(model.field_of_view)
    except ModelError as error:
        return str(error)
    if not (isinstance(model.notes, tuple) and all(isinstance(note, str) for note in model.notes)):
        return f"notes must be a tuple of sentences, got {shown(model.notes)}"
    return (
        _joints_fault(model)
        or _execution_fault(model)
        or _wheels_fault(model)
        or _platform_fault(model, states)
        or _bodies_fault(model, states)
        or _collision_fault(model, world, states)
    )


def _joints_fault(model: Model) -> str:
    joints = model.joints
    if not isinstance(joints, tuple) or not set(joints) <= set(model.space.names) - {"x", "y", "yaw"}:
        return f"joints must be a tuple of names of states other than x, y and yaw, got {shown(joints)}"
    if bool(joints) != ("joints" in model.provides):
        return f"joints is {joints!r}, but provides {'lacks' if joints else 'contains'} 'joints'; change one of them"
    return ""


def _execution_fault(model: Model) -> str:
    executed, kinds = model.executed, set(model.laws)
    if not isinstance(executed, Mapping):
        return f"executed must be a mapping from kinds of laws to kinds of laws, got {shown(executed)}"
    for planned, done in executed.items():
        if planned in kinds and done not in kinds:
            return f"executed must map {planned!r} to one of the laws {', '.join(sorted(kinds))}, got {done!r}"
    return ""


def _wheels_fault(model: Any) -> str:
    if "wheels" not in model.provides:
        return ""
    curves = "rigid" in model.provides
    for name in (*WHEELS, *(RIGID if curves else ())):
        value = getattr(model, name, None)
        if not (isinstance(value, int | float) and 0.0 < value < math.inf):
            return (
                f"provides contains 'wheels', so {name} must be a positive number (see hpop.motions.Wheeled), "
                f"got {shown(value)}"
            )
    if curves and "drive" not in model.laws:
        return (
            "provides contains 'wheels' and 'rigid', so the laws must include 'drive' for curves, "
            f"got {', '.join(model.laws)}"
        )
    return ""


def _platform_fault(model: Model, states: States) -> str:
    """Return a fault of a planar model's platform, such as a part that extends beyond it; "" if there is none."""
    strange = [part for part in model.platform if not isinstance(part, Part) or part.on]
    if strange:
        return f"platform must hold parts that no joint carries (hpop.models.base.Part), got {shown(strange[0])}"
    if "plane" not in model.provides:
        return ""
    if not model.platform:
        return "provides contains 'plane', so platform must hold at least one part, got none"
    reach, top = max(part.reach for part in model.platform), max(part.z_max for part in model.platform)
    for part in model.parts:
        corners = part.placed(states) - np.stack([states.x, states.y], axis=1)[:, None]
        farthest = float(np.hypot(*corners.transpose(2, 0, 1)).max()) + part.radius
        if farthest > reach + SAME:
            return f"a part reaches {farthest:.6g} m from the axis, but the platform only {reach:.6g} m; enlarge it"
        if (highest := part.z_max + float(part.lift(states).max())) > top + SAME:
            return f"a part reaches a height of {highest:.6g} m, but the platform only {top:.6g} m; make it higher"
    return ""


def _bodies_fault(model: Model, states: States) -> str:
    for shape, poses in model.bodies(states):
        if not hasattr(shape, "corners") and not hasattr(shape, "radius"):
            return f"bodies must be shapes of hpop.world.geometry.solids, each with poses, got {shown(shape)}"
        if np.shape(poses) not in ((4, 4), (1, 4, 4), (states.size, 4, 4)):
            return f"the poses of a body must have the shape (4, 4) or ({states.size}, 4, 4), got {np.shape(poses)}"
        if not np.isfinite(poses).all():
            return "the poses of a body must be finite, got nan or infinity"
    return ""


def _collision_fault(model: Model, world: World, states: States) -> str:
    """Return the first fault of the optional attributes of the model's collision test; "" if there is none."""
    collision = collision_of(model, world)
    if (clearance := collision.clearance) is not None:
        found = np.asarray(clearance(states))
        if found.shape != (states.size,) or not (found >= 0.0).all():
            return (
                f"clearance of its collision test must return a distance >= 0 for each state, got "
                f"{shown(found.tolist())}"
            )
    if "plane" not in model.provides or collision.posture_matters or not model.joints:
        return ""
    other = States(**states.__dict__ | {name: getattr(states, name)[::-1] for name in model.joints})
    if (collision.states_free(states) != collision.states_free(other)).any():
        return "its collision test depends on joints, but its posture_matters is False; set it to True"
    return ""


def law_says(motions: Motions) -> str:
    """Check the optional attributes of a motion law (extra, quadrature, reversible) on example motions.

    Returns the first fault, "" if there is none.
    """
    law = motions.law
    extra = law.extra
    if not isinstance(extra, tuple) or not all(isinstance(name, str) for name in extra):
        return f"extra of a {law.kind} must be a tuple of names of states, got {shown(extra)}"
    if law.quadrature not in (None, "adaptive"):
        return f"quadrature of a {law.kind} must be 'adaptive' or None, got {shown(law.quadrature)}"
    if not law.reversible:
        return ""
    there, back = law.phases(motions.start, motions.end), law.phases(motions.end, motions.start)
    lasts, again = (sum(phase.duration for phase in phases) for phases in (there, back))
    back_text = f"of a {law.kind}, which is reversible, on the way back"
    if fault := differ(f"duration {back_text}", lasts, again, SAME, 1.0):
        return fault
    share = np.full(len(motions), 0.3)
    for name in law.varies:
        onward = law.interpolate(name, motions.start, motions.end, share)
        other = law.interpolate(name, motions.end, motions.start, 1.0 - share)
        if fault := differ(f"{name} {back_text}", onward, other, 1e-6, 1.0):
            return fault
    return ""


def criterion_says(criterion: Criterion) -> str:
    """Return the first fault of the declarations of a criterion; "" if there is none."""
    choices = {
        "group": (criterion.group, get_args(Group)),
        "aggregate": (criterion.aggregate, get_args(Aggregate)),
        "role": (criterion.role, (None, *get_args(Role))),
        "smooth": (criterion.smooth, (True, False)),
        "world_frame": (criterion.world_frame, (True, False)),
    }
    for name, (value, allowed) in choices.items():
        if value not in allowed:
            return f"{name} must be one of {', '.join(map(str, allowed))}, got {shown(value)}"
    if not getattr(getattr(class_of(criterion), "__dataclass_params__", None), "frozen", True):
        return "the dataclass must be frozen, as costs are kept by the criterion: write @dataclass(frozen=True)"
    for name in ("name", "unit"):
        if not (isinstance(value := getattr(criterion, name), str) and value.strip()):
            return f"{name} must be a text that is not empty, got {shown(value)}"
    for name in ("requires", "instead"):
        value = getattr(criterion, name)
        if not isinstance(value, tuple) or not all(isinstance(one, str) for one in value):
            return f"{name} must be a tuple of names, such as ('camera',), got {shown(value)}"
    if strange := [name for name in criterion.instead if name not in criteria]:
        return f"instead must hold names of registered criteria, got {', '.join(strange)}"
    if not (isinstance(criterion.quantum, int | float) and 0.0 < criterion.quantum < math.inf):
        return f"quantum must be a positive number, got {shown(criterion.quantum)}"
    for name in ("bound", "convex"):
        if not (getattr(criterion, name) is None or callable(getattr(criterion, name))):
            return f"{name} must be a method or None, got {shown(getattr(criterion, name))}"
    return _integral_fault(criterion)


def _integral_fault(criterion: Criterion) -> str:
    integral = criterion.integral
    if integral is None:
        return ""
    if criterion.aggregate != "time-mean":
        return f"integral must be None unless aggregate is 'time-mean', but aggregate is {criterion.aggregate!r}"
    if not isinstance(integral, Criterion) or integral.aggregate != "sum":
        return f"integral must be a criterion with the aggregate 'sum', got {shown(integral)}"
    return ""


def as_trajectories(motions: Motions) -> Iterator[Trajectory]:
    """Yield each motion as a trajectory."""
    names = motions.start.names
    ends = {name: np.stack([getattr(motions.start, name), getattr(motions.end, name)], axis=1) for name in names}
    for i in range(len(motions)):
        yield Trajectory(motions.model, States(**{name: ends[name][i] for name in names}), (motions.kind,))


def _columns(vector: Vector, size: int) -> FloatArray:
    """Return the three components of a vector, each a column or a number, as an array (3, N)."""
    return np.stack([np.broadcast_to(column, (size,)) for column in vector])


def axes_of(pose: Pose, size: int) -> FloatArray:
    """Return the position of a pose, and its axes ahead, left and up, as an array (4, 3, N)."""
    return np.stack([_columns(v, size) for v in ((pose.x, pose.y, pose.z), pose.ahead, pose.left, pose.up)])


def _rotations(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the rotation vectors (3, N) between two frames, given by their axes (3, 3, N), for small angles."""
    turned: FloatArray = 0.5 * np.cross(before, after, axis=1).sum(axis=0)
    return turned


def axes_fault(bodies: list[str], batches: list[Motions]) -> str:
    """Return a message if the axes of a body are not orthonormal, or do not match its yaw and pitch; "" otherwise."""
    for motions in batches:
        for body in bodies:
            pose = motions.model.pose(body, motions.start)
            _, ahead, left, up = axes_of(pose, len(motions))
            products = np.einsum("ikn,jkn->ijn", *(np.stack([ahead, left, up]),) * 2)
            unit = np.broadcast_to(np.eye(3)[:, :, None], products.shape)
            if fault := differ(f"products of the axes of the {body}", unit, products, SAME, 1.0):
                return fault
            if fault := differ(f"ahead x left of the {body}", up, np.cross(ahead, left, axis=0), SAME, 1.0):
                return fault
            yaw, pitch = (np.broadcast_to(angle, (len(motions),)) for angle in (pose.yaw, pose.pitch))
            along = np.stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
            if fault := differ(f"ahead of the {body} by its yaw and pitch", along, ahead, 1e-6, 1.0):
                return fault
    return ""


def twist_fault(bodies: list[str], batches: list[Motions], rng: np.random.Generator) -> str:
    """Return a message if twists or their rates differ from finite differences of poses or twists; "" otherwise."""
    for motions in batches:
        model = motions.model
        for trajectory in as_trajectories(motions):
            times = rng.uniform(2 * MOMENT, max(3 * MOMENT, trajectory.duration - 2 * MOMENT), MOMENTS)
            states, (rates, changes) = trajectory.at(times), trajectory.rates(times)
            around = [(trajectory.at(t), trajectory.rates(t)[0]) for t in (times - MOMENT, times + MOMENT)]
            for body in bodies:
                before, after = (axes_of(model.pose(body, there), MOMENTS) for there, _ in around)
                twist = model.twist(body, states, rates)
                moved = (after[0] - before[0]) / (2 * MOMENT)
                turned = _rotations(before[1:], after[1:]) / (2 * MOMENT)
                rate = model.twist_rate(body, states, rates, changes)
                begin, end = (model.twist(body, *there) for there in around)
                gains = (
                    (_columns(getattr(end, part), MOMENTS) - _columns(getattr(begin, part), MOMENTS)) / (2 * MOMENT)
                    for part in ("velocity", "rotation")
                )
                for what, expected, found in zip(
                    ("velocity", "rotation", "acceleration", "angular acceleration"),
                    (moved, turned, *gains),
                    (twist.velocity, twist.rotation, rate.velocity, rate.rotation),
                    strict=True,
                ):
                    told = f"{what} of the {body} in a {motions.kind}"
                    if fault := differ(told, expected, _columns(found, MOMENTS), TWIST_TOLERANCE, 10.0):
                        return fault
    return ""


def length_fault(bodies: list[str], batches: list[Motions]) -> str:
    """Return a message if a quantity of a body contradicts its sampled poses; "" otherwise.

    Checked: length, rotation and turning, and whether the body stays, or its camera is steady or upright, as claimed.
    """
    for motions in batches:
        size = len(motions)
        for name in bodies:
            body: Body = motions.body(name)
            way, turned, rotation, tilted = (np.zeros(size) for _ in range(4))
            for i, trajectory in enumerate(as_trajectories(motions)):
                states = trajectory.at(np.linspace(0.0, trajectory.duration, SAMPLES))
                axes = axes_of(motions.model.pose(name, states), SAMPLES)
                steps = _rotations(axes[1:, :, :-1], axes[1:, :, 1:])
                way[i] = np.linalg.norm(np.diff(axes[0]), axis=0).sum()
                turned[i], rotation[i] = np.linalg.norm(steps, axis=0).sum(), steps[2].sum()
                tilted[i] = np.linalg.norm(steps[:2], axis=0).sum()
            compared = {"length": way, "turned": turned, "rotation": rotation}
            for what, expected in compared.items():
                found = getattr(body, what) + np.zeros(size)
                told = f"{what} of the {name} in a {motions.kind}"
                if fault := differ(told, expected, found, BODY_TOLERANCE, float(np.abs(expected).max()) + SAME):
                    return fault
            added = sum(turn + np.zeros(size) for turn in body.turns)
            if fault := differ(f"sum of the turns of the {name} in a {motions.kind}", body.rotation, added, 1e-6, 1.0):
                return fault
            if body.stays and way.max() > SAME:
                return f"stays of the {name} is True in a {motions.kind}, but it moves {way.max():.3g} m"
            if body.steady and turned.max() > SAME:
                return f"steady of the {name} is True in a {motions.kind}, but it turns {turned.max():.3g} rad"
            if body.upright and tilted.max() > SAME:
                return f"upright of the {name} is True in a {motions.kind}, but it tilts {tilted.max():.3g} rad"
    return ""


def extent_fault(bodies: list[str], batches: list[Motions]) -> str:
    """Return a message if a body moves or turns farther than the extent of its motions; "" otherwise."""
    for motions in (batch for batch in batches if not batch.stands):
        farthest, most_turned = (column + np.zeros(len(motions)) for column in motions.model.extent(motions))
        for name in bodies:
            body: Body = motions.model.body(name, motions)
            for what, bound, found in (("moves", farthest, body.length), ("turns", most_turned, body.turned)):
                if (found > bound * (1 + 1e-6) + 1e-6).any():
                    worst = int(np.argmax(found - bound))
                    return (
                        f"the {name} {what} {found[worst]:.6g} in a {motions.kind}, but extent() gives at most "
                        f"{bound[worst]:.6g}"
                    )
    return ""
