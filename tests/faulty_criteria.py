"""Criteria that each make one mistake, for the tests of the conformance checks."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from hpop.base.math import is_symbolic
from hpop.world.content.proxemics import any_moves, expected, offset


@dataclass(frozen=True)
class Base:
    """Declarations of a criterion that is not in the registry."""

    name: ClassVar[str] = "wrong"
    group: ClassVar[str] = "R"
    unit: ClassVar[str] = "m"
    aggregate: ClassVar[str] = "sum"
    requires: ClassVar[tuple[str, ...]] = ()
    smooth: ClassVar[bool] = False
    quantum: ClassVar[float] = 1e-6


@dataclass(frozen=True)
class Negative(Base):
    def cost(self, m):
        return -m.base.length - 1.0


@dataclass(frozen=True)
class NotANumber(Base):
    def cost(self, m):
        return np.full(len(m), np.nan)


@dataclass(frozen=True)
class Infinite(Base):
    def cost(self, m):
        return np.full(len(m), np.inf)


@dataclass(frozen=True)
class OneForAll(Base):
    def cost(self, m):
        return m.base.length.sum()


@dataclass(frozen=True)
class Columns(Base):
    def cost(self, m):
        return np.stack([m.base.length, m.base.turned], axis=1)


@dataclass(frozen=True)
class Words(Base):
    def cost(self, m):
        return np.full(len(m), "long")


@dataclass(frozen=True)
class Failing(Base):
    def cost(self, m):
        return m.base.lenght


CALLS = itertools.count()


@dataclass(frozen=True)
class Moody(Base):
    def cost(self, m):
        return m.base.length * 3.0 ** (next(CALLS) % 50)


@dataclass(frozen=True)
class Unpicklable(Base):
    weight: Any = None

    def cost(self, m):
        return m.base.length


@dataclass(frozen=True)
class Relative(Base):
    """Cross-talk: what a motion costs depends on the others of its batch."""

    def cost(self, m):
        return m.base.length / m.base.length.max() if m.kind == "move" else m.base.turned


@dataclass(frozen=True)
class Timed(Base):
    def cost(self, m):
        return m.integrate(lambda s: s.t)


@dataclass(frozen=True)
class Flat(Base):
    """Cost that is equal for a long and a short move, so that halves cost twice as much."""

    price: float = 1.0

    def cost(self, m):
        return np.full(len(m), self.price)


@dataclass(frozen=True)
class Northward(Base):
    """Knows where north is, and does not say so."""

    def cost(self, m):
        return np.maximum(m.base.end.y - m.base.start.y, 0.0)


@dataclass(frozen=True)
class Boastful(Base):
    """Promises more than it costs."""

    def cost(self, m):
        return m.base.length

    def bound(self, start, goal):
        return 1.1 * np.hypot(goal.x - start.x, goal.y - start.y)


@dataclass(frozen=True)
class Crowded(Base):
    """Costs more among many motions than among few."""

    def cost(self, m):
        return m.base.length * (1.0 + (len(m) > 200))


@dataclass(frozen=True)
class Square(Base):
    scale: float = 1.0

    def cost(self, m):
        return self.scale * m.base.length**2


@dataclass(frozen=True)
class TurningMotions(Base):
    """Right for turns in place, but a curve in pieces would have many turns, or none."""

    def cost(self, m):
        return np.where(m.base.turned > np.radians(1.0), 1.0, 0.0)


@dataclass(frozen=True)
class Grown(Base):
    """Declared a maximum, but it adds up."""

    aggregate: ClassVar[str] = "max"

    def cost(self, m):
        return m.base.length


@dataclass(frozen=True)
class NumbersOnly(Base):
    smooth: ClassVar[bool] = True

    def cost(self, m):
        return np.array([float(length) for length in m.base.length])


@dataclass(frozen=True)
class OtherOnSymbols(Base):
    smooth: ClassVar[bool] = True

    def cost(self, m):
        return 2.0 * m.base.length if is_symbolic(m.start.x) else m.base.length


@dataclass(frozen=True)
class Kinked(Base):
    """Right in value, but its gradient is 0/0 where nothing moves."""

    smooth: ClassVar[bool] = True

    def cost(self, m):
        return np.sqrt((m.end.x - m.start.x) ** 2 + (m.end.y - m.start.y) ** 2)


@dataclass(frozen=True)
class Tiny(Base):
    """A good criterion in an unusual unit: all its costs are below 1e-6."""

    smooth: ClassVar[bool] = True

    def cost(self, m):
        return 1e-7 * m.base.length


@dataclass(frozen=True)
class Memory(Base):
    """A criterion with memory sees the whole history of a trajectory."""

    aggregate: ClassVar[str] = "trajectory"

    def cost(self, m):
        return np.cumsum(m.of_motions(lambda motions: motions.base.length))


@dataclass(frozen=True)
class NegativeMemory(Memory):
    def cost(self, m):
        return -np.cumsum(m.duration)


@dataclass(frozen=True)
class MoodyMemory(Memory):
    def cost(self, m):
        return m.duration + next(CALLS)


QUANTITIES = {
    "x": lambda m, s: s.base.x,
    "y": lambda m, s: s.base.y,
    "yaw": lambda m, s: s.camera.yaw,
    "speed": lambda m, s: s.speed,
    "turn rate": lambda m, s: s.turn_rate,
    "clearance": lambda m, s: m.world.clearance(s.base.x, s.base.y),
    "from the origin": lambda m, s: np.hypot(s.base.x, s.base.y),
    "from a person": lambda m, s: np.hypot(*offset(m.world.content.people[0], s.base.x, s.base.y, None)),
}


@dataclass(frozen=True)
class Limited(Base):
    """Cost of 1 per second, and more where a quantity exceeds a limit: with a jump, or rising ``gradually``."""

    quantity: str
    limit: float
    more: float = 1.0
    gradually: bool = False
    world_frame: ClassVar[bool] = True

    def cost(self, m):
        return m.integrate(lambda s: 1.0 + self.more * self.excess(QUANTITIES[self.quantity](m, s) - self.limit))

    def excess(self, beyond):
        return np.clip(beyond, 0.0, 1.0) if self.gradually else np.where(beyond > 0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Below(Base):
    """Faulty cost, negative where a quantity is below a limit."""

    quantity: str
    limit: float
    world_frame: ClassVar[bool] = True

    def cost(self, m):
        return m.integrate(lambda s: QUANTITIES[self.quantity](m, s) - self.limit)


@dataclass(frozen=True)
class NegativeMemoryAtLeft(Base):
    aggregate: ClassVar[str] = "trajectory"
    world_frame: ClassVar[bool] = True

    def cost(self, m):
        return np.cumsum(m.of_motions(lambda motions: motions.base.end.x + 0.5))


@dataclass(frozen=True)
class Likeliest(Base):
    """Takes the first future of each person for the only one."""

    requires: ClassVar[tuple[str, ...]] = ("base", "people")

    def cost(self, m):
        people = [one for person in m.world.content.people for _, one in person.hypotheses[:1]]
        return m.integrate(lambda s: self.near(people, s.base.x, s.base.y, s.t if any_moves(people) else None))

    def near(self, people, x, y, t):
        return expected(people, lambda person, x, y, t: 1 / (0.1 + np.hypot(*offset(person, x, y, t))), x, y, t)


@dataclass(frozen=True)
class Haunted(Likeliest):
    """Reckons with those who have left."""

    def cost(self, m):
        people = m.world.content.people
        return m.integrate(lambda s: self.near(people, s.base.x, s.base.y, s.t if any_moves(people) else None))

    def near(self, people, x, y, t):
        each = [share for person in people for share in person.hypotheses]
        return sum(weight / (0.1 + np.hypot(*offset(person, x, y, t))) for weight, person in each)


@dataclass(frozen=True)
class Mean(Base):
    """A mean that something else stands in for."""

    aggregate: ClassVar[str] = "time-mean"

    def cost(self, m):
        return m.base.length

    @property
    def integral(self):
        return Square()
