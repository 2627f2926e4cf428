"""Progress of a drive along its tour: which stops were visited, which were skipped, and which remain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.text import shown
from hpop.criteria.visits import Visit, Visits, all_visits, missed_weights, weight_of
from hpop.drive.plan import SAME, between
from hpop.errors import DriveError, did_you_mean
from hpop.goals import Tour
from hpop.motions import HOLD
from hpop.problems.named_rows import StopVisit
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem


@dataclass(frozen=True)
class TourProgress:
    """Stops of a tour that are done at some time of a drive.

    tour         the tour, with the stops that are done
    since        s, time of the plan; what was driven before it counts for no further visit
    visits       visits so far, in order of time, in times of the drive
    passed_over  names of the optional stops that were missed because a later stop was visited
    skipped      names of the stops that were skipped on request, in this order
    """

    tour: Tour
    since: float = 0.0
    visits: tuple[StopVisit, ...] = ()
    passed_over: tuple[str, ...] = ()
    skipped: tuple[str, ...] = ()

    @property
    def remaining(self) -> tuple[str, ...]:
        """Names of the stops that remain, optional ones included, in the order in which the tour lists them."""
        return tuple(self.tour.names[i] for i in self.tour.remaining)

    def after(self, plan: Trajectory, t: float, lag: float, problem: Problem) -> TourProgress:
        """Return the progress at time ``t`` of a plan, s; ``lag`` is the time of the drive at which the plan began.

        Visits are assigned along the whole plan, so that it misses as few stops as possible by their weights. The
        visits that end by ``t`` are done. Optional stops that the order has only before such a visit are passed over.
        The problem has the present world, and the weights.
        """
        if not self.tour.remaining:
            return self
        onward = between(plan, self.since, plan.duration)
        (found,) = all_visits(self.tour, problem.world, [onward], missed_weights(problem.criteria))
        made = [visit for visit in found.visits if self.since + visit.end <= t + SAME]
        since = max(self.since, _standstill(plan, t))
        if not made:
            return replace(self, since=since)
        names, begin, layer, passed = self.tour.names, lag + self.since, 0, list(self.passed_over)
        for visit in made:
            step = next(step for step in self.tour.steps[layer] if step.stop == visit.stop)
            layer, passed = step.layer, [*passed, *(names[i] for i in step.skipped)]
        return replace(
            self,
            tour=replace(self.tour, done=tuple(self.tour.layers[layer])),
            since=max(since, self.since + made[-1].end),
            visits=(
                *self.visits,
                *(StopVisit(v.stop + 1, names[v.stop], begin + v.begin, begin + v.end) for v in made),
            ),
            passed_over=tuple(passed),
        )

    def coming(self, plan: Trajectory, t: float, tour: Tour, problem: Problem) -> Visits:
        """Return the visits of a plan that end after time ``t`` of the plan, s; their times are seconds after ``t``.

        A visit that is under way at ``t`` begins at 0. Missed are the optional stops that remain in ``tour``, the tour
        with the stops done at ``t``, and that the plan does not visit; ``problem`` has their weights.
        """
        weights = missed_weights(problem.criteria)
        (found,) = all_visits(self.tour, problem.world, [between(plan, self.since, plan.duration)], weights)
        ahead = [(visit, self.since - t) for visit in found.visits if self.since + visit.end > t + SAME]
        visits = tuple(Visit(v.stop, max(0.0, v.begin + lag), v.end + lag) for v, lag in ahead)
        made = {visit.stop for visit in visits}
        missed = [i for i in tour.remaining if tour.stops[i].optional and i not in made]
        return Visits(visits, weight_of(tour, missed, weights), found.complete)

    def without(self, stop: str) -> TourProgress:
        """Return the progress with one stop skipped, given by name; DriveError if it does not remain."""
        names = self.tour.names
        if not isinstance(stop, str) or stop not in names:
            raise DriveError(
                f"expected the name of a stop, got {shown(stop)}.{did_you_mean(stop, names)} The stops that remain are "
                f"{_listed(self.remaining)}; give one of these"
            )
        if stop not in self.remaining:
            done = "skipped" if stop in self.skipped else "passed over" if stop in self.passed_over else "visited"
            raise DriveError(
                f"stop {stop!r} was {done} already; the stops that remain are {_listed(self.remaining)}: skip one of "
                "these, or none"
            )
        tour = replace(self.tour, done=(*self.tour.done, stop))
        return replace(self, tour=tour, skipped=(*self.skipped, stop))


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"


def _standstill(plan: Trajectory, t: float) -> float:
    """Return the time, s, at which the motion under way at time ``t`` of a plan began, or the robot came to rest."""
    times, kinds = plan.times, plan.kinds
    i = min(int(np.searchsorted(times, t + SAME, side="right")) - 1, len(plan))
    if i < len(plan) and kinds[i] != HOLD.kind and t > times[i] + SAME:
        return float(times[i])
    while i > 0 and kinds[i - 1] == HOLD.kind:
        i -= 1
    return float(times[i])
