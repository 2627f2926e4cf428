"""Holds: a robot stands still for a while. A law of the house, which every model has without saying so."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column
from hpop.base.registry import completed
from hpop.motions.laws import Law, LawDefaults, Model, Phase
from hpop.motions.states import States

CLOCK = "clock"  # s, from any zero: the state whose differences are the durations of holds and curves
LONGEST = 3600.0  # s, of all holds of a trajectory: more is given in another unit, and would be sampled without end


@checked_arguments
@dataclass(frozen=True)
class Hold(LawDefaults):
    """Standing still: nothing changes but the clock, whose difference is the duration.

    Motions of other laws pass the clock through unread.
    """

    kind: str = "hold"

    varies = frozenset({CLOCK})
    extra = (CLOCK,)

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """One, in which the share is that of the time."""
        duration = end.clock - start.clock
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "cruise"),)

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """The clock when a share of the time has passed."""
        begin = getattr(start, name)
        return begin + (getattr(end, name) - begin) * share


HOLD = Hold()


@checked_arguments
def laws_of(model: Model) -> Mapping[str, Law]:
    """Motion laws by kind: the model's own, and those of the house."""
    return {**{kind: completed(law, vars(LawDefaults)) for kind, law in model.laws.items()}, HOLD.kind: HOLD}


@checked_arguments
def stands(law: Law) -> bool:
    """Whether nothing of a robot moves under a law."""
    return law.varies <= {CLOCK}
