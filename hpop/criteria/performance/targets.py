"""Views of a target: its direction, its distance, and which share of it is hidden."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import Column
from hpop.base.math import angle_between, norm
from hpop.base.options import FARTHEST, LEAST, MOST, real, set_reals, set_wholes
from hpop.base.text import shown
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.motions import Instants, Motions, Vector
from hpop.world.geometry.rays_in_space import Surfaces, refuse_symbols, rows, stacked_poses, surfaces_of
from hpop.world.geometry.solids import Solid


@dataclass(frozen=True)
class Targeted:
    """Base class for criteria on how the camera views a target: a position (x, y, z), m, or a body of the robot."""

    target: tuple[float, float, float] | str

    def __post_init__(self) -> None:
        object.__setattr__(self, "target", checked_target(self.target))
        if isinstance(self.target, str):
            needs: Any = type(self)
            object.__setattr__(self, "requires", (*needs.requires, self.target))

    @property
    def places(self) -> tuple[tuple[float, float, float], ...]:
        """Positions that pictures mark: the target, unless it is a body, which moves."""
        return () if isinstance(self.target, str) else (self.target,)

    def position(self, s: Instants) -> Vector:
        """Return the position (x, y, z) of the target, m, as three columns or numbers."""
        if isinstance(self.target, str):
            pose = s.pose(self.target)
            return pose.x, pose.y, pose.z
        return self.target

    def offset(self, s: Instants) -> Vector:
        """Return the vector from the camera to the target, m, as three columns."""
        x, y, z = self.position(s)
        return x - s.camera.x, y - s.camera.y, z - s.camera.z


def checked_target(target: Any) -> tuple[float, float, float] | str:
    """Check a target and return it as three floats, m, or the name of a body; CriterionError for anything else."""
    if isinstance(target, str) and target:
        return target
    try:
        x, y, z = target
    except (TypeError, ValueError):
        raise CriterionError(
            f"target must be a position (x, y, z) in m, or the name of a body, got {shown(target)}"
        ) from None
    kind = "(x, y, z), each a coordinate in m,"
    x, y, z = (float(real("target", value, -FARTHEST, FARTHEST, kind, error=CriterionError)) for value in (x, y, z))
    return x, y, z


@criterion("look_at", group="P", unit="rad s", aggregate="sum", requires=("camera",), world_frame=True)
@dataclass(frozen=True)
class LookAtCriterion(Targeted):
    """Angle between the middle of the view and the target, over time: ∫ γ dt.

    target  (x, y, z)  m, world frame; or the name of a body of the robot, such as "work_tool" (two_arms)

    γ is the angle between the camera's axis ahead and the direction to the target, rad in [0, π]; 0 where the camera is
    at the target. Unit rad s; a sum over motions.

    Source: the look-at objective of Rakita, Mutlu and Gleicher (HRI 2018; RSS 2019). γ is computed as atan2(|a × d|, a
    · d), which is exact at small angles, where an arc cosine loses half the digits.
    """

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the angle (M,), rad s."""
        return m.integrate(lambda s: angle_between(s.camera.ahead, self.offset(s)))


@criterion("view_distance", group="P", unit="m s", aggregate="sum", requires=("camera",), world_frame=True)
@dataclass(frozen=True)
class ViewDistance(Targeted):
    """Distance by which the camera is too near to a target or too far away, over time: ∫ (near - d)₊ + (d - far)₊ dt.

    target     (x, y, z)  m, world frame; or the name of a body of the robot, such as "work_tool" (two_arms)
    near, far  m          band of good distances

    d is the distance from the camera to the target. Unit m s; a sum over motions.

    Source: the distance objective of Rakita, Mutlu and Gleicher (HRI 2018; RSS 2019). Deviation: theirs has one best
    distance, this one a band. From all distances in the band the target is sharp and large enough, and the other costs
    decide among them.
    """

    near: float = 0.2
    far: float = 0.6

    def __post_init__(self) -> None:
        super().__post_init__()
        set_reals(self, "near", "far", least=0, most=MOST, kind="a distance in m", error=CriterionError)
        if not self.near <= self.far:
            raise CriterionError(f"near must not exceed far, in m, got near={self.near!r}, far={self.far!r}")

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the distance outside the band (M,), m s."""

        def outside(s: Instants) -> Column:
            distance = norm(self.offset(s))
            return np.maximum(np.maximum(self.near - distance, distance - self.far), 0.0)

        return m.integrate(outside)


BLOCK = 1024  # states in one call: the poses of their bodies fit into the processor's cache


@criterion("occlusion", group="P", unit="s", aggregate="sum", requires=("camera",), smooth=False, world_frame=True)
@dataclass(frozen=True)
class Occlusion(Targeted):
    """Time for which the target is hidden: ∫ (share of the rays from the camera to the target that are blocked) dt.

    target  (x, y, z)  m, world frame; or the name of a body of the robot, such as "work_tool" (two_arms)
    radius  m          of a ball that contains the target
    rays               number of rays, spread evenly over the ball as the camera sees it

    A ray is blocked if it enters a solid of the world, or a body of the robot (the model's ``bodies``), before it
    reaches the ball. Solids within the ball do not block rays, nor do solids that contain or touch the camera, such as
    the hand that carries it. Unit s; a sum over motions. It does not matter whether the camera looks at the target;
    ``look_at`` measures that.

    Source: the occlusion objective of Rakita, Mutlu and Gleicher (RSS 2019).

    Accuracy: the share jumps as each ray becomes blocked or free, and the time of a jump is found to about a hundredth
    of the motion's duration. In 40,000 motions of an arm, the error was below 0.25 % of the cost on average, at
    most 0.011 s in 99 % of the motions, and at most 0.09 s. The largest errors come from rays that change twice while
    the arm turns by less than 0.25 rad. `hpop check` reports the jumps. Programs on CasADi symbols, such as those of
    splines, cannot use this criterion.
    """

    radius: float = 0.1
    rays: int = 37

    def __post_init__(self) -> None:
        super().__post_init__()
        set_reals(self, "radius", least=LEAST, most=999, kind="a length in m", error=CriterionError)
        set_wholes(self, "rays", least=1, most=10_000, kind="a number of rays", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the blocked share (M,), s."""
        refuse_symbols(m.start.__dict__.values())
        world, first = surfaces_of(m.world), m.start.take(np.arange(min(1, len(m))))
        shapes = [shape for shape, _ in m.model.bodies(first)]
        surfaces = world.joined(Surfaces.of([Solid(shape, np.eye(4)) for shape in shapes]))
        return m.integrate_flags(lambda s, rays: self._find_blocked(surfaces, len(world), s, rays), self.rays)

    def _find_blocked(self, surfaces: Surfaces, fixed: int, s: Instants, rays: NDArray[np.int8]) -> None:
        """Write to rays (N, K), where they are 2, whether those to the target are blocked: 0 or 1."""
        size, bodies = s.state.size, s.model.bodies
        camera = rows((s.camera.x, s.camera.y, s.camera.z), size)
        offsets = rows(self.offset(s), size)
        for begin in range(0, size, BLOCK):
            part = slice(begin, begin + BLOCK)
            state = s.state if size <= BLOCK else s.state.take(part)
            placed = stacked_poses([pose for _, pose in bodies(state)], len(camera[part]))
            surfaces.find_blocked(fixed, placed, camera[part], offsets[part], self.radius, rays[part])
