"""What a nonlinear program needs of worlds, laws and motions: sparse derivatives, no cusps, maxima sample by sample.

Numbers never see any of this: fronts hold the exact costs of the exact laws.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.arrays import Column
from hpop.errors import OptionError
from hpop.models.rigid import PlanarLaw
from hpop.motions import Motions, Phase, Rate, States
from hpop.motions.symbolic import elementwise
from hpop.planners.needs import in_plane
from hpop.world import World
from hpop.world.field import Field
from hpop.world.ground import WHOLE, Heights

if TYPE_CHECKING:
    from hpop.problem import Problem

ROUNDING = 0.02  # rad: the time of smaller turns is not believed


def require_ipopt(planner: str) -> None:
    """Raise OptionError where CasADi came without its solver."""
    import casadi

    if not casadi.has_nlpsol("ipopt"):
        raise OptionError(
            f"{planner} needs the solver IPOPT, which this installation of CasADi does not have; install CasADi's own "
            "wheel (pip install --force-reinstall casadi), or use planner 'lattice'"
        )


def vector(column: Column, size: int) -> Any:
    """A column of numbers, or of symbols (SX, MX), as a CasADi vector (size,)."""
    import casadi

    if isinstance(column, int | float | np.ndarray | np.generic):
        return casadi.DM(np.broadcast_to(np.asarray(column, float), (size,)).copy())
    return casadi.vec(column.to_casadi() if hasattr(column, "to_casadi") else column)


def reaches(problem: Problem) -> tuple[tuple[Heights, float], ...]:
    """Height ranges that see different obstacles, each with the largest reach of the robot's parts there, m."""
    found: dict[int, tuple[Heights, float]] = {}
    for part in in_plane(problem.model).parts:
        z = (part.z_min, part.z_max)
        key = id(problem.world.free_space(z))
        found[key] = max(found.get(key, (z, 0.0)), (z, part.reach), key=lambda item: item[1])
    return tuple(found.values())


class _Mapped:
    """A field's CasADi function whose maps have sparse derivatives."""

    def __init__(self, function: Any) -> None:
        self._function = function

    def map(self, size: int) -> Any:
        return elementwise(self._function, size)


class SparseField(Field):
    """A field whose symbols have sparse derivatives."""

    def _build(self) -> Any:
        return _Mapped(super()._build())

    @classmethod
    def of(cls, field: Field) -> Field:
        """The same samples, all of them."""
        sparse = object.__new__(cls)
        shared = {name: value for name, value in field.__dict__.items() if name != "_function"}
        sparse.__dict__.update({**shared, "values": field.values})
        return sparse


class SparseWorld(World):
    """The same world, with fields that suit nonlinear programs."""

    def clearance_field(self, *, z: Heights = WHOLE) -> Field:
        key = ("sparse clearance", self.ground.layer(z))
        return self.derived(key, lambda: SparseField.of(World.clearance_field(self, z=z)))

    def obstruction_field(self, radius: float, z: float = 0.0) -> Field:
        key = ("sparse obstruction", radius, z)
        return self.ground.derived(key, lambda: SparseField.of(World.obstruction_field(self, radius, z)))


@dataclass(frozen=True)
class Rounded:
    """A law of turns whose timing is that of ``sqrt(θ² + ROUNDING²)`` instead of |θ|.

    A turn from rest to rest lasts 2 sqrt(|θ|/α): no solver likes that cusp, and vertices where hardly a turn is left
    would be stuck on it.
    """

    exact: PlanarLaw

    @property
    def kind(self) -> str:
        return self.exact.kind

    @property
    def varies(self) -> frozenset[str]:
        return self.exact.varies

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        turned = end.yaw - start.yaw
        yaw = start.yaw + np.sqrt(turned * turned + ROUNDING**2)
        return self.exact.phases(start, States(x=end.x, y=end.y, yaw=yaw))

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        return self.exact.interpolate(name, start, end, share)

    def travel(self, start: States, end: States, lever: float) -> Column:
        return self.exact.travel(start, end, lever)

    def turned(self, start: States, end: States) -> Column:
        return self.exact.turned(start, end)


@dataclass(frozen=True, eq=False)
class _Moment(Motions):
    """Motions whose worst moment is looked for at one moment only, so that a slack can lie above each."""

    phase: int = 0
    at: float = 0.0

    def worst(self, rate: Rate, *, detail: float | None = None) -> Column:
        """The rate (M,) at that moment."""
        return rate(self._instants(self.phases[self.phase], self.at, None))


def moments(motions: Motions) -> list[Motions]:
    """The same motions seen at both ends and in the middle of each of their phases."""
    m = motions
    return [
        _Moment(m.world, m.model, m.law, m.start, m.end, panels=m.panels, phase=phase, at=at)
        for phase in range(len(m.phases))
        for at in (0.0, 0.5, 1.0)
    ]
