"""O-space: the middle of a group of people who talk, which others should not cross."""

from __future__ import annotations

import math
from dataclasses import dataclass
from math import prod

import numpy as np

from hpop.base.arrays import Column
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.others import check_one_future, clock
from hpop.errors import CriterionError
from hpop.motions import Motions
from hpop.world.content.content import Person
from hpop.world.content.proxemics import over, position


@criterion("o_space", group="O", unit="s", aggregate="sum", requires=("base", "groups"))
@dataclass(frozen=True)
class OSpace:
    """Time in the middle of conversations, weighted by nearness to the centre c: ∫ Σ_groups E[exp(-|p - c|²/2σ²)] dt.

    p is the position of the base's axis. The centre is c = mean(p_i + ``stride`` · heading_i) over the people of the
    group, where p_i is a position and heading_i the direction of the body, also of people who walk while they talk. A
    second at the centre costs 1 s. A conversation lasts while all its people are present. Unit s; a sum over motions.

    Source: the centre of an F-formation is found by votes: each person votes for a point ahead (Kendon 1990; a stride
    of 1.5 m). The width σ = ``sigma``, half a stride, is this library's choice.

    E is the mean over the uncertain positions of the people, whose deviations are taken as independent, in closed form.
    People in groups must have one predicted future each, because separate futures of each person do not tell how the
    conversation continues.
    """

    stride: float = 1.5  # m from each person ahead to the centre
    sigma: float = 0.75  # m, width σ of the middle

    def __post_init__(self) -> None:
        set_reals(self, "stride", least=0, most=MOST, kind="a length in m", error=CriterionError)
        set_reals(self, "sigma", least=LEAST, most=MOST, kind="a positive length in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the weighted time (M,) in the middle of conversations, s."""
        content = m.world.content
        groups = [tuple(content.people[i] for i in group) for group in content.groups]
        talking = [person for group in groups for person in group]
        check_one_future("o_space", talking)

        def intrusion(group: tuple[Person, ...], x: Column, y: Column, t: Column | None) -> Column:
            centre_x, centre_y = self.centre(group, t)
            square = (x - centre_x) ** 2 + (y - centre_y) ** 2
            own = self.sigma**2
            wide = own + sum(person.deviation(t) ** 2 for person in group) / len(group) ** 2
            shares = [own / wide, *(person.there(t) for person in group)]  # 1.0 where nothing is uncertain
            return prod(shares) * np.exp(square * (-0.5 / wide))

        return m.integrate(lambda s: over(groups, intrusion, np.add, s.base.x, s.base.y, clock(s, talking)))

    def centre(self, group: tuple[Person, ...], t: Column | None = None) -> tuple[Column, Column]:
        """Return the centre (x, y), m, of a group's conversation at times t (N,), s; t may be None if all stand."""
        positions = [position(person, t) for person in group]
        ahead = self.stride / len(group)
        x = sum(px for px, _ in positions) / len(group) + ahead * sum(math.cos(person.yaw) for person in group)
        y = sum(py for _, py in positions) / len(group) + ahead * sum(math.sin(person.yaw) for person in group)
        return x, y
