"""What earlier people tell of the next one: their shares of the costs, pooled in part, and what their profiles add.

Empirical Bayes: the shares of people are taken for draws of one Dirichlet distribution, whose concentrations are what
makes the answers of all most probable, drawn towards those of a person of whom nothing is known; so a few people change
little. Each person comes in as the draws of their own posterior, with all its doubt. From ``LEAST_PEOPLE`` people on
the concentrations also depend on a profile (sickness in cars, experience of virtual reality, age), log-linearly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from hpop.arrays import FloatArray
from hpop.errors import StudyError
from hpop.options import MOST, real
from hpop.preference.preference import Preference
from hpop.preference.prior import Prior
from hpop.text import shown

LEAST_PEOPLE = 20
"""From which on a profile is used; of fewer it is reported alone."""
DRAWS = 200
"""Of the shares of each person."""
OF_COSTS, OF_PROFILE = 0.5, 0.5
"""Standard deviations, before any person, of the logarithms of concentrations, and of what a profile does to them."""
LOGS = -4.0, 6.0
"""Least and greatest logarithm of a concentration."""
MOST_APART = 1.1
"""Ratio of the ranges of a cost up to which shares of it are about the same."""
Profile = Mapping[str, float]


class Association(NamedTuple):
    """How a number of the profile goes with the expected share of a cost.

    correlation  Spearman's; NaN of fewer than three people, or where one of the two is the same of all
    people       how many said that number
    """

    profile: str
    cost: str
    correlation: float
    people: int


@dataclass(frozen=True, eq=False)
class People:
    """Preferences of several people about one question, and their profiles.

    preferences  of people who answered the same question about the same costs
    profiles     numbers by name, such as {"mssq": 12.5, "age_band": 3}, one profile a person, or none at all; what
                 somebody did not say is left out
    """

    preferences: Sequence[Preference]
    profiles: Sequence[Profile] = ()
    names: tuple[str, ...] = field(init=False)
    _table: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "preferences", tuple(self.preferences))
        object.__setattr__(self, "profiles", tuple(map(dict, self.profiles)))
        if not self.preferences:
            raise StudyError("expected the preferences of at least one person, got none")
        about = {(person.question, person.scale.columns) for person in self.preferences}
        if len(about) > 1:
            said = "; ".join(sorted(f"{question}: {', '.join(columns)}" for question, columns in about))
            raise StudyError(
                f"people are pooled who answered one question about the same costs, got {said}; pool each alone"
            )
        self._check_ranges()
        if self.profiles and len(self.profiles) != len(self.preferences):
            raise StudyError(f"expected {len(self.preferences)} profiles, one a person, got {len(self.profiles)}")
        names = tuple(sorted({name for profile in self.profiles for name in profile}))
        object.__setattr__(self, "names", names)
        table = [self._numbers(profile) for profile in self.profiles or [{}] * len(self)]
        object.__setattr__(self, "_table", np.array(table))

    def __len__(self) -> int:
        return len(self.preferences)

    @property
    def uses_profile(self) -> bool:
        """Whether there are people enough that a profile says what to expect of the next one."""
        return bool(self.names) and len(self) >= LEAST_PEOPLE

    def prior(self, profile: Profile | None = None) -> Prior:
        """What to think of the next person, who may have a profile: a prior for :meth:`Preference.fit`.

        A number beyond those of all these people counts as the nearest of theirs. Raises StudyError for a profile that
        has what none of these people's has.
        """
        if strange := sorted({*(profile or {})} - {*self.names}):
            known = ", ".join(self.names) or "none"
            raise StudyError(f"no profile has {', '.join(map(shown, strange))}; what theirs have: {known}")
        found = self._fitted(self._design(self._table))
        logs = np.clip(self._design(self._numbers(profile or {})[None]) @ found, *LOGS)[0]
        random = (sum(person.random for person in self.preferences) + 1.0) / (len(self) + 5.0)  # as Prior, at first
        return Prior(concentration=tuple(np.exp(logs).tolist()), random=min(random, 0.9))

    def associations(self) -> list[Association]:
        """How each number of the profile goes with the expected share of each cost, over those who said it."""
        from scipy.stats import spearmanr

        found = []
        for p, name in enumerate(self.names):
            known = ~np.isnan(self._table[:, p])
            for cost in self.preferences[0].scale.columns:
                shares = np.array([person.weights[cost] for person in self.preferences])
                says = known.sum() > 2 and np.ptp(self._table[known, p]) > 0 and np.ptp(shares[known]) > 0
                value = float(spearmanr(self._table[known, p], shares[known]).statistic) if says else float("nan")
                found.append(Association(name, cost, value, int(known.sum())))
        return found

    def _check_ranges(self) -> None:
        """StudyError where shares are of ranges that differ, or of other units: they are not of the same."""
        scales = [person.scale for person in self.preferences]
        for j, name in enumerate(scales[0].names):
            spans = [float(scale.span[j]) for scale in scales]
            low, high = min(spans), max(spans)
            if high > MOST_APART * low or len({scale.units[j] for scale in scales}) > 1:
                ends = [f"{span:g} {scales[spans.index(span)].units[j]}" for span in (low, high)]
                raise StudyError(
                    f"people are pooled who were asked about fronts of about the same ranges, of which shares are: the "
                    f"range of {shown(name)} is {ends[0]} of some, {ends[1]} of others; pool each alone"
                )

    def _numbers(self, profile: Profile) -> FloatArray:
        for name, value in profile.items():
            real(f"{shown(name)} of a profile", value, -MOST, MOST, error=StudyError)
        return np.array([float(profile.get(name, np.nan)) for name in self.names])

    def _design(self, table: FloatArray) -> FloatArray:
        """What the concentrations depend on, a row a person: 1, and where it is used the profile, scaled."""
        one = np.ones((len(table), 1))
        if not self.uses_profile:
            return one
        middle = np.nanmean(self._table, axis=0)
        spread = np.nanstd(self._table, axis=0)
        inside = np.clip(table, np.nanmin(self._table, axis=0), np.nanmax(self._table, axis=0))
        scaled = (inside - middle) / np.where(spread > 0, spread, 1.0)
        return np.hstack([one, np.where(np.isnan(scaled), 0.0, scaled)])

    def _fitted(self, design: FloatArray) -> FloatArray:
        """Logarithms of concentrations (1 + profile, f) that make the answers of all most probable."""
        from scipy.optimize import minimize
        from scipy.special import gammaln, logsumexp

        rng = np.random.default_rng(0)
        parts: list[Any] = [person.draws.equal(DRAWS, rng) for person in self.preferences]
        logs = np.log(np.stack([part.shares for part in parts]))  # (people, draws, f)
        already = np.stack([person.prior.concentrations(logs.shape[2]) for person in self.preferences])
        shape = (design.shape[1], logs.shape[2])
        sizes = np.array([OF_COSTS] + [OF_PROFILE] * (shape[0] - 1))[:, None]

        def loss(flat: FloatArray) -> float:
            found = flat.reshape(shape)
            concentration = np.exp(np.clip(design @ found, *LOGS))  # (people, f)
            ratio = np.einsum("pdf,pf->pd", logs, concentration - already)
            constant = gammaln(concentration.sum(axis=1)) - gammaln(concentration).sum(axis=1)
            return float((0.5 * (found / sizes) ** 2).sum() - (constant + logsumexp(ratio, axis=1)).sum())

        return np.asarray(minimize(loss, np.zeros(shape).ravel(), method="L-BFGS-B").x.reshape(shape))
