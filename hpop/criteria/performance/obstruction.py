"""Obstruction of the camera: the paper's V, a mean over time; exposure, the integral that adds up; the worst moment."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.base.options import set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.models.camera import rises
from hpop.motions import Motions, Rate
from hpop.world.fields.obstruction import filled
from hpop.world.geometry.rays_in_space import rows

SMALLEST = 0.1  # m: the obstruction is sampled four times a radius, on a map of any size


@dataclass(frozen=True)
class _Obstructed:
    """A camera whose surroundings within ``radius`` metres are partly filled by obstacles."""

    radius: float = 2.0  # m, of the ball round the camera

    def __post_init__(self) -> None:
        set_reals(self, "radius", least=SMALLEST, most=999, kind="a length in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Time integral (M,) of the obstructed fraction, s."""
        return m.integrate(self._fraction(m))

    def _fraction(self, m: Motions) -> Rate:
        """The obstructed fraction: read from a field of its height, or, where that changes, in space."""
        if not rises(m.model):
            return lambda s: m.world.obstruction(s.camera, self.radius)
        share = filled(m.world, self.radius)
        return lambda s: share(rows((s.camera.x, s.camera.y, s.camera.z), s.state.size))


@criterion("exposure", group="P", unit="s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class Exposure(_Obstructed):
    """S = ∫ phi(p(t)) dt: the time for which a fully obstructed camera would be as bad.

    The additive part of the paper's V = S/T, so exact searches can minimise it.
    """


@criterion("obstruction", group="P", unit="1", aggregate="time-mean", requires=("camera",))
@dataclass(frozen=True)
class Obstruction(_Obstructed):
    """V = (1/T) ∫ phi(p(t)) dt, phi(p) = volume(ball(p, r) ∩ obstacles) / volume(ball(p, r)).

    Becerra et al. 2020 (arXiv 2002.10696). A mean is not additive: graph searches optimise :class:`Exposure` instead
    and report V. Floor and ceiling are no obstacles.

    Of a camera whose height changes (in the hand of an arm, on a lift) phi is the mean over 1,000 rays of what solids
    in space fill of each, at the nodes of a grid a tenth of r apart and by cubics between them: within .004 beside
    walls and boxes, .0002 in the mean on a shelf. Beyond the extent is then no obstacle, and there are no symbols.
    """

    @property
    def integral(self) -> Exposure:
        """What adds up in its place."""
        return Exposure(self.radius)


@criterion("worst_obstruction", group="P", unit="1", aggregate="max", requires=("camera",))
@dataclass(frozen=True)
class WorstObstruction(_Obstructed):
    """max over t of phi(p(t)): the obstructed fraction where the view is worst; phi as in :class:`Obstruction`.

    A mean hides a short squeeze through a narrow passage in a long walk; the maximum does not. Not in the paper. It is
    looked for at both ends and in the middle of pieces no longer than a field cell c: as phi changes by at most 3/(4 r)
    a metre (what a moving disc sweeps, over the ball), no more than 3 c / (16 r) is missed.
    """

    def cost(self, m: Motions) -> Column:
        """Largest obstructed fraction (M,)."""
        return m.worst(self._fraction(m))
