"""Surroundings of the camera: how much of them obstacles fill, and which share of the space is visible.

Obstruction makes three criteria: the mean over time (V of Becerra et al. 2020), its integral (exposure), and the worst
moment. Openness makes two: the mean and the integral (enclosure).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from hpop.base.arrays import Column
from hpop.base.options import LEAST, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.models.rigid import height_varies
from hpop.motions import Motions, Rate
from hpop.world.fields.obstruction import filled
from hpop.world.geometry.rays_in_space import rows
from hpop.world.sight import sight_in_space
from hpop.world.sight.visibility import openness

SMALLEST = 0.1  # m: smallest radius; there are always four samples in a radius, on a map of any size


@dataclass(frozen=True)
class _Obstructed:
    """Fraction of a ball round the camera, with a radius of ``radius`` m, that obstacles fill."""

    radius: float = 2.0  # m, of the ball round the camera

    def __post_init__(self) -> None:
        set_reals(self, "radius", least=SMALLEST, most=999, kind="a length in m", error=CriterionError)

    @property
    def ball_radius(self) -> float:
        """Radius of the ball, m, for pictures."""
        return self.radius

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the obstructed fraction (M,), s."""
        return m.integrate(self._fraction(m))

    def _fraction(self, m: Motions) -> Rate:
        """Return a rate: a function of moments within motions that returns the obstructed fraction (N,), 0 to 1."""
        if not height_varies(m.model):
            return lambda s: m.world.obstruction(s.camera, self.radius)
        share = filled(m.world, self.radius)
        return lambda s: share(rows((s.camera.x, s.camera.y, s.camera.z), s.state.size))


@criterion("exposure", group="P", unit="s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class Exposure(_Obstructed):
    """Time spent with obstacles round the camera: S = ∫ phi(p(t)) dt, where phi is the obstructed fraction of a ball.

    Two seconds in a ball half filled by obstacles cost 1 s. Unit s; a sum over motions. Searches minimise it in place
    of the mean V = S/T, :class:`Obstruction`, which defines phi.
    """


@criterion("obstruction", group="P", unit="1", aggregate="time-mean", requires=("camera",))
@dataclass(frozen=True)
class Obstruction(_Obstructed):
    """Obstructed fraction of the camera's surroundings, as a mean over time: V = (1/T) ∫ phi(p(t)) dt.

    phi(p) = volume(ball(p, r) ∩ obstacles) / volume(ball(p, r)), with p the position of the camera and r the
    ``radius``. Floor and ceiling are no obstacles. Unit 1; a mean over time. A mean does not add up along a path, so
    graph searches minimise :class:`Exposure` and report V.

    Source: Becerra et al. 2020 (arXiv 2002.10696).

    If the camera's height changes (on an arm or a lift), phi is the mean, over 1,000 rays, of the share of each ray
    that lies in solids. It is computed at the nodes of a grid a tenth of r apart and interpolated by cubics. Its error
    is at most 0.004 beside walls and boxes, and 0.0002 on average on a shelf. The space beyond the border of the map
    then counts as free, and programs on CasADi symbols cannot use the criterion.
    """

    @property
    def integral(self) -> Exposure:
        """The criterion that searches minimise in place of the mean: its time integral."""
        return Exposure(self.radius)


@criterion("worst_obstruction", group="P", unit="1", aggregate="max", requires=("camera",))
@dataclass(frozen=True)
class WorstObstruction(_Obstructed):
    """Largest obstructed fraction on the way: max over t of phi(p(t)), with phi as in :class:`Obstruction`.

    A mean over a long path hides a short narrow passage; the maximum does not. Unit 1; the worst moment. The definition
    is this project's own.

    Accuracy: the maximum is taken over the ends and middles of pieces no longer than c, a cell of the distance grid.
    phi changes by at most 3/(4 r) per metre (the volume swept by a moving disc, divided by that of the ball), so the
    true maximum is larger by at most 3 c / (16 r).
    """

    def cost(self, m: Motions) -> Column:
        """Return the largest obstructed fraction (M,)."""
        return m.worst(self._fraction(m))


@dataclass(frozen=True)
class _Enclosed:
    """Share of the surroundings, up to ``radius`` metres, that the camera cannot see."""

    radius: float = 5.0  # m, range of sight

    def __post_init__(self) -> None:
        set_reals(self, "radius", least=LEAST, most=999, kind="a length in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the time integral (M,), s, of the share of the surroundings that the camera cannot see."""
        if height_varies(m.model):
            return m.integrate(lambda s: 1.0 - sight_in_space.openness(m.world, s.camera, s.state.size, self.radius))
        return m.integrate(lambda s: 1.0 - openness(m.world, s.camera, self.radius))


@criterion("enclosure", group="P", unit="s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class Enclosure(_Enclosed):
    """Time spent in enclosed surroundings: ∫ (1 - A(p(t)) / (pi r²)) dt, where A is the visible area.

    A second in which the camera sees nothing but a wall at the lens costs 1 s, a second in the open costs nothing. Unit
    s; a sum over motions. Searches minimise it in place of the mean, :class:`Openness`, which defines A.
    """


@criterion("openness", group="P", unit="1", aggregate="time-mean", requires=("camera",))
@dataclass(frozen=True)
class Openness(_Enclosed):
    """Share of the surroundings that the camera cannot see, as a mean over time: 1 - (1/T) ∫ A(p(t)) / (pi r²) dt.

    A = ½ ∫ min(R(θ), r)² dθ is the area of the isovist, the area that is visible from p. R(θ) is the distance to the
    nearest obstacle in direction θ that reaches the camera's height, and r is the ``radius``. The cost is 0 in the
    open. Unlike in ``obstruction``, objects behind a wall do not count, and a thin wall counts as much as a thick one.
    Unit 1; a mean over time.

    Source: isovists of Benedikt (1979). If the camera's height changes, R is found by rays at its current height.
    """

    quantity: ClassVar[str] = "unseen share"

    @property
    def integral(self) -> Enclosure:
        """The criterion that searches minimise in place of the mean: its time integral."""
        return Enclosure(self.radius)
