"""The last step of a smoothed polyline: its program again, with exact costs and distances in its bounds.

The first solution has a margin and weights of time and effort, and reads obstacles from a field, so it only lies near a
local optimum. From there the program is solved again almost without these weights. What its field and its samples are
off where the solution lies is added to its bounds: a first-order correction, as in trust-region methods with
approximate models (Alexandrov, Dennis, Lewis and Torczon 1998, doi 10.1007/BF01197433). A solution counts if its
reported costs are lower and it is free on the exact geometry.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from hpop.base.arrays import FloatArray
from hpop.planners.programs.outcome import Improved
from hpop.planners.programs.smoothing.clearances import exact, raised
from hpop.planners.programs.smoothing.phases import Guess
from hpop.planners.programs.smoothing.program import Asked, Driven, DrivenProgram

REPAIRS = 4  # solves with corrected bounds after a solution that is not to be trusted
SPARE = 2.2e-3  # m: kept from obstacles, as the certificate of a curve takes robots to be 2 mm larger
RAISED = 1.1 * SPARE  # m: kept where a solution came too near between two samples


class Judged(NamedTuple):
    """A solution with its exact costs (k,) and their merit, and the candidate that it is; None if it is not trusted."""

    driven: Driven
    costs: FloatArray
    merit: float
    candidate: Improved | None


def refined(
    begin: Judged,
    program: DrivenProgram,
    guess: Guess,
    asked: Callable[[Judged], Asked],
    judge: Callable[[Driven], Judged],
) -> Judged | None:
    """Return the local optimum near a solution; None where no solve converged to one that is trusted.

    Parameters
    ----------
    guess : that the solution was found from: signs and phases
    asked : from a solution to weights, bounds and scales of the costs
    judge : from a solution to its exact costs, and whether it is trusted on the exact geometry
    """
    bounds, clearances = asked(begin), exact(program, begin.driven.goes, SPARE)
    for _ in range(1 + REPAIRS):
        driven = program.refined(begin.driven, guess, bounds, clearances)
        if driven.trajectory is None:
            return None
        found = judge(driven)
        if found.candidate is not None:
            return found if found.merit < begin.merit else begin
        bounds, clearances = asked(found), raised(program, clearances, driven.goes, RAISED)
        begin = begin._replace(driven=driven)
    return None
