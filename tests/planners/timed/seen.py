"""A criterion whose cost depends on where the camera is, and when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import hpop


@hpop.criterion("seen_from_the_camera", group="O", unit="s", aggregate="sum", requires=("people",))
@dataclass(frozen=True)
class SeenFromTheCamera:
    """Time with the camera near to the first person."""

    def cost(self, m):
        person = m.world.content.people[0]

        def near(s):
            x, y = person.at(s.t)
            return np.exp(-((s.camera.x - x) ** 2) - (s.camera.y - y) ** 2) * person.there(s.t)

        return m.integrate(near)
