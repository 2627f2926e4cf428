"""What a body at the tip does in reaches: how far it goes and turns, which the way alone decides, not its timing.

In the space of the joints a reach is straight, so with the ways D of the joints, and the Jacobians J of the body,
∫|ω| dt = ∫ |J_ω(q(s)) D| ds over the share s done: one smooth integrand in the place of three phases.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property

import numpy as np

from hpop.base.arrays import Column, IntArray
from hpop.base.math import is_symbolic, norm
from hpop.models.serial_arm.kinematics import Kinematics
from hpop.motions import Body, Motions, States, Twist
from hpop.motions.quadrature import adaptive_integrals, evenly, pieces_of

PIECES = 3  # of a reach on symbols, unless its batch says otherwise
NODES = [0.5 + 0.5 * place for place in (-math.sqrt(6 / 7), -math.sqrt(1 / 3), 0.0, math.sqrt(1 / 3), math.sqrt(6 / 7))]
KRONROD = [49 / 495, 27 / 110, 14 / 45, 27 / 110, 49 / 495]
"""The five nodes on [0, 1] and weights of Kronrod's rule (1965) on Gauss' of two nodes, exact to degree 7."""


class ArmBody(Body):
    """A body at the tip; what is not read is not integrated."""

    def __init__(self, name: str, kinematics: Kinematics, motions: Motions) -> None:
        ends = {key: kinematics.pose(name, states) for key, states in (("start", motions.start), ("end", motions.end))}
        self.__dict__.update(ends, _name=name, _kinematics=kinematics, _ends=(motions.start, motions.end))
        self.__dict__.update(_motions=motions)

    _name: str
    _kinematics: Kinematics
    _ends: tuple[States, States]
    _motions: Motions

    @cached_property
    def length(self) -> Column:
        return self._along(lambda twist: norm(twist.velocity), self._motions.twins)

    @cached_property
    def turned(self) -> Column:
        return self._along(lambda twist: norm(twist.rotation), self._motions.twins)

    @cached_property
    def rotation(self) -> Column:
        return self._along(lambda twist: twist.rotation[2], np.arange(len(self._motions)))

    @property
    def turns(self) -> tuple[Column, ...]:
        return (self.rotation,)

    def _along(self, amount: Callable[[Twist], Column], twins: IntArray) -> Column:
        """What twists add up to between the ends (M,), that of motions with the same twin once."""
        start, end = self._ends
        names = self._kinematics.chain.names
        ways = States(**{name: getattr(end, name) - getattr(start, name) for name in names})

        def at(share: Column, owner: IntArray | None = None) -> Column:
            begin, way = (start, ways) if owner is None else (start.take(owner), ways.take(owner))
            there = States(**{name: getattr(begin, name) + getattr(way, name) * share for name in names})
            return amount(self._kinematics.twist(self._name, there, way))

        symbolic = any(is_symbolic(getattr(ways, name)) for name in names)
        if not symbolic and self._motions.panels is None:
            _, turned = self._motions.model.extent(self._motions)
            return adaptive_integrals(at, evenly, np.unique(twins), pieces_of(turned))[twins]
        count = self._motions.panels or PIECES
        return sum(
            weight / count * at((i + node) / count)
            for i in range(count)
            for node, weight in zip(NODES, KRONROD, strict=True)
        )
