"""Whether a model's bodies go and turn as their poses do: twists, lengths and bounds against differences of poses."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.motions import Body, Motions, Pose, States
from hpop.motions.states import Vector
from hpop.testing.checks import SAME, differ
from hpop.trajectories.trajectory import Trajectory

MOMENTS = 40  # within each motion
MOMENT = 1e-6  # s, of differences
SAMPLES = 1000  # along a motion whose way and rotation are measured
TWIST_TOLERANCE = 1e-4  # relative, of differences
BODY_TOLERANCE = 5e-3  # relative: quadrature, and polygons in the place of curves


def _each(motions: Motions) -> Iterator[Trajectory]:
    """Each of some motions as a trajectory of its own."""
    names = motions.start.names
    ends = {name: np.stack([getattr(motions.start, name), getattr(motions.end, name)], axis=1) for name in names}
    for i in range(len(motions)):
        yield Trajectory(motions.model, States(**{name: ends[name][i] for name in names}), (motions.kind,))


def _columns(vector: Vector, size: int) -> FloatArray:
    """Three columns, or numbers in their place, as an array (3, N)."""
    return np.stack([np.broadcast_to(column, (size,)) for column in vector])


def axes_of(pose: Pose, size: int) -> FloatArray:
    """Place and axes (4, 3, N) of a pose."""
    return np.stack([_columns(v, size) for v in ((pose.x, pose.y, pose.z), pose.ahead, pose.left, pose.up)])


def _rotations(before: FloatArray, after: FloatArray) -> FloatArray:
    """Rotation vectors (3, N), of small angles, from some axes (3, 3, N) to others."""
    turned: FloatArray = 0.5 * np.cross(before, after, axis=1).sum(axis=0)
    return turned


def upright(bodies: list[str], batches: list[Motions]) -> str:
    """What is wrong with the axes of bodies: not at right angles, not of length 1, or not as their angles say."""
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


def twisted(bodies: list[str], batches: list[Motions], rng: np.random.Generator) -> str:
    """What is wrong with twists and their rates, held against differences of poses and twists."""
    for motions in batches:
        model = motions.model
        for trajectory in _each(motions):
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


def measured(bodies: list[str], batches: list[Motions]) -> str:
    """What is wrong with how far bodies go and turn, held against sums over samples of their poses."""
    for motions in batches:
        size = len(motions)
        for name in bodies:
            body: Body = motions.body(name)
            way, turned, rotation, tilted = (np.zeros(size) for _ in range(4))
            for i, trajectory in enumerate(_each(motions)):
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
                return f"the {name} is said to stay in a {motions.kind}, but goes {way.max():.3g} m"
            if body.steady and turned.max() > SAME:
                return f"the {name} is said not to turn in a {motions.kind}, but turns {turned.max():.3g} rad"
            if body.upright and tilted.max() > SAME:
                return f"the {name} is said to stay upright in a {motions.kind}, but tilts {tilted.max():.3g} rad"
    return ""


def bounded(bodies: list[str], batches: list[Motions]) -> str:
    """Which body goes or turns farther than the extent of its motions."""
    for motions in (batch for batch in batches if not batch.stands):
        farthest, most_turned = (column + np.zeros(len(motions)) for column in motions.model.extent(motions))
        for name in bodies:
            body: Body = motions.model.body(name, motions)
            for what, bound, found in (("goes", farthest, body.length), ("turns", most_turned, body.turned)):
                if (found > bound * (1 + 1e-6) + 1e-6).any():
                    worst = int(np.argmax(found - bound))
                    return f"the {name} {what} {found[worst]:.6g} in a {motions.kind}, the bound is {bound[worst]:.6g}"
    return ""
