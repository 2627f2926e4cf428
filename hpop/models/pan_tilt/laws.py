"""The motion law of a head that turns back as its base turns: the base and the pan against each other."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.base.math import smooth_abs
from hpop.models.laws import Turn, linear, rest_to_rest, standing
from hpop.motions import Phase, States


@dataclass(frozen=True)
class Unwind(Turn):
    """The base turns and the head turns back by the same angle, so that the view stays as it is.

    Both keep one profile, that of the slower: ``turn_rate`` and ``turn_acceleration`` are within the limits of both.
    """

    loss: float = 0.0
    kind: str = "unwind"

    varies = frozenset({"yaw", "pan"})

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """From rest to rest, by the angle of the base."""
        spin = rest_to_rest(smooth_abs(end.yaw - start.yaw), self.turn_rate, self.turn_acceleration)
        return standing(spin, self.loss) if self.loss else spin

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """State ``name`` where a share of the angle is done; the pan has as far to go back as the yaw goes on."""
        return start.pan - (end.yaw - start.yaw) * share if name == "pan" else linear(name, start, end, share)

    def slopes(self, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
        """Of the pan, that of the yaw with the other sign to the last bit: what both add up to is zero."""
        return (start.yaw - end.yaw if name == "pan" else end.yaw - start.yaw), 0.0

    def strays(self, start: States, end: States) -> Column:
        """By how much (M,), rad, the view turns between the ends that are given."""
        return smooth_abs((end.yaw - start.yaw) + (end.pan - start.pan))
