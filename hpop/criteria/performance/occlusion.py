"""Occlusion: which share of a target is hidden from the camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.base.options import LEAST, set_reals, set_wholes
from hpop.criteria.base import criterion
from hpop.criteria.performance import Targeted
from hpop.errors import CriterionError
from hpop.motions import Instants, Model, Motions
from hpop.world.geometry.rays_in_space import Surfaces, rows, surfaces_of, towards_ball
from hpop.world.geometry.solids import Solid

BLOCK = 1 << 14  # rays in one call: they fit into the processor's cache


@criterion("occlusion", group="P", unit="s", aggregate="sum", requires=("camera",), smooth=False, world_frame=True)
@dataclass(frozen=True)
class Occlusion(Targeted):
    """Time for which the target is hidden: ∫ (share of the rays from the camera to the target that are blocked) dt.

    target  (x, y, z)  m, world frame
    radius  m          of a ball that contains the target
    rays               number of rays, spread evenly over the ball as the camera sees it

    A ray is blocked if it enters a solid of the world, or a body of the robot (the model's ``bodies``), before it
    reaches the ball. Solids within the ball do not block rays, nor do solids that contain or touch the camera, such as
    the hand that carries it. Unit s; a sum over motions. It does not matter whether the camera looks at the target;
    ``look_at`` measures that.

    Source: the occlusion objective of Rakita, Mutlu and Gleicher (RSS 2019).

    Accuracy: the share jumps as each ray becomes blocked or free, and the time of a jump is found to about a hundredth
    of the motion's duration. In 2,000 long reaches of an arm, the error of the cost was 0.2 % on average and at most
    0.02 s. Programs on CasADi symbols, such as those of splines, cannot use this criterion.
    """

    radius: float = 0.1
    rays: int = 37

    def __post_init__(self) -> None:
        super().__post_init__()
        set_reals(self, "radius", least=LEAST, most=999, kind="a length in m", error=CriterionError)
        set_wholes(self, "rays", least=1, most=10_000, kind="a number of rays", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the blocked share (M,), s."""
        surfaces = surfaces_of(m.world)
        return m.integrate(lambda s: self._blocked_share(m.model, surfaces, s), jumps=True)

    def _blocked_share(self, model: Model, surfaces: Surfaces, s: Instants) -> FloatArray:
        """Return the share (N,) of rays to the target that are blocked."""
        size = s.state.size
        camera = rows((s.camera.x, s.camera.y, s.camera.z), size)
        bodies = model.bodies(s.state)
        shapes = Surfaces.of([Solid(shape, np.eye(4)) for shape, _ in bodies])
        poses = np.stack([pose for _, pose in bodies]) if bodies else np.empty((0, size, 4, 4))
        share, step = np.empty(size), max(1, BLOCK // self.rays)
        for begin in range(0, size, step):
            part = slice(begin, begin + step)
            share[part] = surfaces.blocked(
                shapes, poses[:, part], camera[part], *towards_ball(camera[part], self.target, self.radius, self.rays)
            )
        return share
