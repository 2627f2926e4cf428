"""Occlusion: how much of a target is hidden from the camera."""

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

BLOCK = 1 << 14  # rays at once: they stay in the processor's cache


@criterion("occlusion", group="P", unit="s", aggregate="sum", requires=("camera",), smooth=False, world_frame=True)
@dataclass(frozen=True)
class Occlusion(Targeted):
    """∫ share of rays from the camera to the target that are blocked dt: the time for which not seeing it is as bad.

    target  (x, y, z)  m, world frame
    radius  m          of a ball that holds the target
    rays               evenly over the ball as the camera sees it

    The occlusion objective of Rakita, Mutlu and Gleicher (RSS 2019). A ray is blocked where it enters a solid of the
    world, or a body of the robot itself (:meth:`bodies` of a model that has some), before it gets to the ball; what is
    within the ball, the target itself, hides nothing, and neither does what contains the camera, such as the hand that
    carries it, or touches it. The share jumps from ray to ray, and each jump is timed to a hundredth of the motion or
    so: of 2,000 long reaches of an arm the cost was off by .2 % in the mean, and by .02 s at worst. Whether the camera
    looks there is for ``look_at`` to say. Rays have no symbols: splines leave this cost as it comes.
    """

    radius: float = 0.1
    rays: int = 37

    def __post_init__(self) -> None:
        super().__post_init__()
        set_reals(self, "radius", least=LEAST, most=999, kind="a length in m", error=CriterionError)
        set_wholes(self, "rays", least=1, most=10_000, kind="a number of rays", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Time integral (M,) of the blocked share, s."""
        surfaces = surfaces_of(m.world)
        return m.integrate(lambda s: self._blocked(m.model, surfaces, s), jumps=True)

    def _blocked(self, model: Model, surfaces: Surfaces, s: Instants) -> FloatArray:
        """Blocked share (N,) of the rays."""
        size = s.state.size
        place = rows((s.camera.x, s.camera.y, s.camera.z), size)
        own = model.bodies(s.state)
        shapes = Surfaces.of([Solid(shape, np.eye(4)) for shape, _ in own])
        poses = np.stack([where for _, where in own]) if own else np.empty((0, size, 4, 4))
        share, step = np.empty(size), max(1, BLOCK // self.rays)
        for begin in range(0, size, step):
            part = slice(begin, begin + step)
            share[part] = surfaces.blocked(
                shapes, poses[:, part], place[part], *towards_ball(place[part], self.target, self.radius, self.rays)
            )
        return share
