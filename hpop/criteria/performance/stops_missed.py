"""Missed stops: the number, or total weight, of a tour's optional stops that a trajectory does not visit."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from hpop.base.arrays import Column
from hpop.base.options import whole
from hpop.base.text import shown
from hpop.criteria.base import criterion
from hpop.criteria.visits import all_visits
from hpop.errors import CriterionError, did_you_mean
from hpop.goals.tour import Tour
from hpop.motions import Motions
from hpop.trajectories.history import History

MOST_WEIGHT = 1000


@criterion("stops_missed", group="P", unit="1", aggregate="trajectory", smooth=False, quantum=1.0, role="stops_missed")
@dataclass(frozen=True)
class StopsMissed:
    """Number of optional stops of the problem's tour that the trajectory does not visit, or the sum of their weights.

    weights  weights of optional stops by name, whole numbers from 1; a stop without an entry has weight 1

    Unit 1, a count; a criterion of the whole trajectory. Searches on graphs can minimise it exactly nevertheless: each
    state of the graph is combined with the set of stops visited so far, and skipping a stop costs its weight.
    """

    tour: ClassVar[Tour | None] = None

    weights: Mapping[str, int] | None = None

    def __post_init__(self) -> None:
        if self.weights is None:
            return
        if not isinstance(self.weights, Mapping):
            raise CriterionError(
                f"weights must map names of optional stops to whole numbers, such as {{'the vase': 2}}, got "
                f"{shown(self.weights)}"
            )
        checked = {
            name: whole(f"the weight of {name}", weight, 1, MOST_WEIGHT, error=CriterionError)
            for name, weight in self.weights.items()
        }
        object.__setattr__(self, "weights", checked)

    def of_tour(self, tour: Tour | None) -> Self:
        """Return a copy of the criterion for the tour of a problem.

        Raises CriterionError if the tour has no optional stops, or if ``weights`` names a stop that is not among them.
        """
        names = [] if tour is None else [tour.names[i] for i in tour.optional]
        if not names:
            lack = "the problem has no tour" if tour is None else "no stop of this tour is optional"
            raise CriterionError(
                f"stops_missed needs a tour with optional stops, but {lack}; set optional: true for a stop, or leave "
                "the criterion out"
            )
        for name in self.weights or {}:
            if name not in names:
                raise CriterionError(
                    f"weights of stops_missed must name optional stops, got {shown(name)}.{did_you_mean(name, names)} "
                    f"The optional stops are {', '.join(names)}"
                )
        made = copy(self)
        object.__setattr__(made, "tour", tour)
        return made

    def cost(self, m: History) -> Column:
        """Return the sum of the weights (M,) of the optional stops that are not visited by the end of each motion.

        It is 0 for a batch of motions, which have no history: searches add the weights.
        """
        if self.tour is None or isinstance(m, Motions):  # a motion by itself has no cost: searches add the weights
            return np.zeros(len(m))
        weights = self.weights or {}
        (found,) = all_visits(self.tour, m.world, [m.trajectory], weights)
        missed = np.full(len(m), found.missed)
        for visit in found.visits:
            if visit.stop in self.tour.optional:
                missed += weights.get(self.tour.names[visit.stop], 1.0) * (m.t0 + m.duration < visit.end - 1e-9)
        return missed

    def without_motions(self, m: History) -> float:
        """Return the cost of a trajectory without motions, which visits stops without dwell at its only state."""
        return 0.0 if self.tour is None else all_visits(self.tour, m.world, [m.trajectory], self.weights)[0].missed
