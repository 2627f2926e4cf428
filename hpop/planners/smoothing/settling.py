"""The last step of a smoothed polyline: linear programs on exact costs and geometry, until no small step gains.

The program of :mod:`.program` has a barrier, a margin, weights of time and effort, and reads obstacles from a field, so
its solutions only lie near a local optimum. From there the controls move by sequential linear programming within a
trust region (Fletcher and Sainz de la Maza 1989, doi 10.1007/BF01582292): every step is made feasible by Newton's
method, and counts if the costs that fronts report are lower and the trajectory is free on the exact geometry.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hpop.arrays import FloatArray
from hpop.planners.smoothing.phases import Guess
from hpop.planners.smoothing.program import Asked, Driven, DrivenProgram

FIRST, LAST, MOST = 0.1, 5e-4, 0.4  # m, m/s, rad, rad/s or s: how far a step is believed, at first, at least, at most
SHRINKS, GROWS = 0.35, 1.7  # where a step was too far, and where it was not
STEPS = 25
GAIN = 5e-5  # of the merit: a step that promises less is not taken
CORRECTIONS = 2  # programs that know what the step before met, before less is believed
SPARE = 2.2e-3  # m: kept from obstacles, as the certificate of a curve takes robots to be 2 mm larger


class Settled(NamedTuple):
    """Where the controls came to rest.

    driven   solution
    steps    count
    left     share of the merit that the next step promised; 0 where that was no gain
    """

    driven: Driven
    steps: int
    left: float


@dataclass(frozen=True, eq=False)
class Settling:
    """Steps of a solution that lower its merit.

    program
    guess    that the solution was found from: signs and phases
    asked    from a solution to weights, bounds and scales of the costs
    merit    from a solution to its exact merit, or None where it is not to be trusted
    is_late  whether time is over
    """

    program: DrivenProgram
    guess: Guess
    asked: Callable[[Driven], Asked]
    merit: Callable[[Driven], float | None]
    is_late: Callable[[], bool]

    def run(self, driven: Driven) -> Settled:
        """Move the controls until no step gains, or time is over."""
        merit, distance, left = self.merit(driven), FIRST, np.nan
        if merit is None:
            return Settled(driven, 0, left)
        for steps in range(STEPS):
            bounds = self.program.distances(driven, SPARE)
            further, distance, left = self._step(driven, merit, self.asked(driven), bounds, distance)
            if further is None:
                return Settled(driven, steps, left if left > GAIN else 0.0)
            (driven, merit), distance = further, min(MOST, distance * GROWS)
        return Settled(driven, STEPS, left)

    def _step(
        self, driven: Driven, merit: float, asked: Asked, bounds: Sequence[FloatArray], distance: float
    ) -> tuple[tuple[Driven, float] | None, float, float]:
        """A step that lowers the merit, if there is one, how far it is believed, and what the last promised."""
        left = np.nan
        while distance >= LAST:
            clearances, seen = bounds, asked
            for correction in range(1 + CORRECTIONS):
                if self.is_late():
                    return None, distance, left
                trial, promised = self.program.step(driven, self.guess, seen, clearances, distance)
                promised /= max(merit, 1e-9)
                if not correction:
                    left = promised
                if promised <= GAIN or trial is None or trial.trajectory is None:
                    break
                found = self.merit(trial)
                if found is not None and found < merit * (1 - 0.1 * GAIN):
                    return (trial, found), distance, left
                if found is not None:
                    break
                seen = self.asked(trial)
                clearances = self.program.raised(clearances, trial.goes, 1.5 * SPARE)
            if left <= GAIN:
                break
            distance *= SHRINKS
        return None, distance, left
