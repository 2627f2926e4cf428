"""Prior belief about the next participant, learnt from the answers and the profiles of earlier participants.

Method: empirical Bayes. The shares of people are taken as draws of one Dirichlet distribution. Its concentrations
maximise the probability of all answers; they are shrunk towards the default prior, so that a few people change
little. Each person enters through the draws of their own posterior, which carry their uncertainty. Shares refer to
the mean ranges of all people: a person who answered about a front with other ranges is rescaled by units. From
``LEAST_PEOPLE`` people on, the concentrations also depend log-linearly on a profile (sickness in cars, experience of
virtual reality, age).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.options import MOST, real
from hpop.base.text import shown
from hpop.errors import StudyError
from hpop.preference.answers import Measure
from hpop.preference.preference import Preference
from hpop.preference.prior import SELECTIVE, Prior, log_dirichlet, range_ratio, rescale_shares

LEAST_PEOPLE = 20
"""Least number of people for a prior that uses profiles; with fewer, associations are only reported."""
DRAWS = 200
"""Number of draws of each person's shares that are used."""
OF_COSTS, OF_PROFILE = 0.5, 0.5
"""Prior standard deviations of the logarithms of concentrations, and of the effects of a profile on them."""
LOGS = -4.0, 6.0
"""Least and greatest logarithm of a concentration."""
Profile = Mapping[str, float]


class Association(NamedTuple):
    """Rank correlation, over people, between a number of their profiles and their expected share of a cost.

    profile      name of the number in the profile
    cost         name of the cost
    correlation  Spearman's rank correlation; NaN for fewer than three people, or if one of the two is constant
    people       number of people whose profile has that number
    """

    profile: str
    cost: str
    correlation: float
    people: int


@checked_arguments
@dataclass(frozen=True, eq=False)
class People:
    """Preferences of several people, with their profiles.

    All people were asked for the same thing, such as "prefer" or "comfort".

    preferences  one for each person, with equal ``question`` and equal costs; the pairs that they compared may differ
    profiles     one dictionary for each person, with numbers by name, such as {"mssq": 12.5, "age_band": 3}; a missing
                 number is left out of the dictionary. () if profiles are not used
    """

    preferences: Sequence[Preference]
    profiles: Sequence[Profile] = ()
    names: tuple[str, ...] = field(init=False)
    measures: tuple[Measure, ...] = field(init=False)
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
                f"expected people with equal questions and equal costs, got {said}; pool each group of people alone"
            )
        object.__setattr__(self, "measures", self._common_measures())
        if self.profiles and len(self.profiles) != len(self.preferences):
            raise StudyError(
                f"expected {len(self.preferences)} profiles, one for each person, got {len(self.profiles)}"
            )
        names = tuple(sorted({name for profile in self.profiles for name in profile}))
        object.__setattr__(self, "names", names)
        table = [self._profile_values(profile) for profile in self.profiles or [{}] * len(self)]
        object.__setattr__(self, "_table", np.array(table))

    def __len__(self) -> int:
        return len(self.preferences)

    @property
    def uses_profile(self) -> bool:
        """True if profiles are given and there are enough people for a prior that depends on the profile."""
        return bool(self.names) and len(self) >= LEAST_PEOPLE

    def prior(self, profile: Profile | None = None) -> Prior:
        """Return the prior of the next person, for :meth:`Preference.fit`.

        It depends on the next person's profile only if :attr:`uses_profile`; otherwise the profile is ignored.
        A number of the profile is clipped to the range of these people's numbers. Raises StudyError for a number that
        none of these people's profiles has.
        """
        if strange := sorted({*(profile or {})} - {*self.names}):
            known = ", ".join(self.names) or "none"
            raise StudyError(
                f"no earlier participant has {', '.join(map(shown, strange))} in the profile; "
                f"their profiles have: {known}"
            )
        found = self._log_concentrations(self._design(self._table))
        logs = np.clip(self._design(self._profile_values(profile or {})[None]) @ found, *LOGS)[0]
        random = (sum(person.random for person in self.preferences) + 1.0) / (len(self) + 5.0)  # as Prior, at first
        selective = (sum(map(_selective_probability, self.preferences)) + 5.0 * SELECTIVE) / (len(self) + 5.0)
        return Prior(
            tuple(np.exp(logs).tolist()),
            random=min(random, 0.9),
            selective=min(selective, 0.9),
            about=self.measures,
        )

    def associations(self) -> list[Association]:
        """Return how each number of the profiles correlates with the expected share of each cost."""
        from scipy.stats import spearmanr

        found = []
        expected = np.array([list(person.weights.values()) for person in self.preferences])  # (people, f)
        expected, _ = rescale_shares(expected, np.ones(len(self)), self._range_factors())
        for p, name in enumerate(self.names):
            known = ~np.isnan(self._table[:, p])
            for j, cost in enumerate(self.preferences[0].scale.columns):
                shares = expected[:, j]
                says = known.sum() > 2 and np.ptp(self._table[known, p]) > 0 and np.ptp(shares[known]) > 0
                value = float(spearmanr(self._table[known, p], shares[known]).statistic) if says else float("nan")
                found.append(Association(name, cost, value, int(known.sum())))
        return found

    def _common_measures(self) -> tuple[Measure, ...]:
        """Return the ranges to which pooled shares refer: for each cost, the geometric mean of the people's ranges.

        Raises StudyError for differing units, and for ranges that differ too much to rescale: those of a logarithmic
        cost by more than a tenth, because no unit relates them.
        """
        first, *others = (person.scale.measures for person in self.preferences)
        for other in others:
            for one, another in zip(first, other, strict=True):
                range_ratio(one, another)
        sizes = np.array([[one.size for one in measures] for measures in (first, *others)])  # (people, f)
        logs = np.log(np.where(sizes > 0, sizes, 1.0)).sum(axis=0) / np.maximum((sizes > 0).sum(axis=0), 1)
        means = np.where(np.ptp(sizes, axis=0) > 0, np.exp(logs), sizes[0])
        return tuple(one._replace(size=size) for one, size in zip(first, means.tolist(), strict=True))

    def _range_factors(self) -> FloatArray:
        """Return, for each person and each of f scaled costs, the pooled range divided by the person's: (people, f)."""
        return np.array([
            [range_ratio(*two) for two in zip(person.scale.measures, self.measures, strict=True)]
            for person in self.preferences
        ])  # fmt: skip

    def _profile_values(self, profile: Profile) -> FloatArray:
        """Return the numbers of a profile in the order of ``names``; NaN if missing."""
        numbers = {
            name: real(f"{shown(name)} of a profile", value, -MOST, MOST, error=StudyError)
            for name, value in profile.items()
        }
        return np.array([numbers.get(name, np.nan) for name in self.names])

    def _design(self, table: FloatArray) -> FloatArray:
        """Return the design matrix (people, d) for :meth:`_log_concentrations`, from a table of profiles.

        The result has a row for each profile: 1, followed by the scaled profile if profiles are used. A number is
        clipped to the range of these people's numbers, and scaled: its distance from their mean, in their standard
        deviations. A missing number becomes 0.
        """
        one = np.ones((len(table), 1))
        if not self.uses_profile:
            return one
        middle = np.nanmean(self._table, axis=0)
        spread = np.nanstd(self._table, axis=0)
        inside = np.clip(table, np.nanmin(self._table, axis=0), np.nanmax(self._table, axis=0))
        scaled = (inside - middle) / np.where(spread > 0, spread, 1.0)
        return np.hstack([one, np.where(np.isnan(scaled), 0.0, scaled)])

    def _log_concentrations(self, design: FloatArray) -> FloatArray:
        """Return coefficients (d, f) of the log concentrations for a design matrix (people, d), shrunk towards 0.

        ``design @ coefficients`` are the log concentrations that make the answers of all people most probable. Row 0
        has those of an average person; each further row has the effect of a number of the profile.
        """
        from scipy.optimize import minimize
        from scipy.special import logsumexp

        rng = np.random.default_rng(0)
        pooled_shares, already = [], []
        for person, factors in zip(self.preferences, self._range_factors(), strict=True):
            draws = person.draws.equally_weighted(DRAWS, rng)
            sharp = np.where(draws.sharpness > 0, draws.sharpness, 1.0)
            shares, common = rescale_shares(draws.shares, sharp, factors)
            pooled_shares.append(shares)
            of_shares, own = person.prior.log_densities(draws.shares, sharp, draws.ties)
            _, pooled = replace(person.prior, _stretch=()).log_densities(shares, common, draws.ties)
            already.append(of_shares + np.where(draws.sharpness > 0, own - pooled, 0.0))
        of_people, known = np.stack(pooled_shares), np.stack(already)  # (people, draws, f), (people, draws)
        shape = (design.shape[1], of_people.shape[2])
        sizes = np.array([OF_COSTS] + [OF_PROFILE] * (shape[0] - 1))[:, None]

        def loss(flat: FloatArray) -> float:
            found = flat.reshape(shape)
            concentration = np.exp(np.clip(design @ found, *LOGS))  # (people, f)
            ratio = log_dirichlet(of_people, concentration[:, None, :]) - known
            return float((0.5 * (found / sizes) ** 2).sum() - logsumexp(ratio, axis=1).sum())

        return np.asarray(minimize(loss, np.zeros(shape).ravel(), method="L-BFGS-B").x.reshape(shape))


def _selective_probability(person: Preference) -> float:
    """Return the posterior probability that a person cares for only some of the costs."""
    return float(person.draws.probability()[(person.draws.shares == 0).any(axis=1)].sum())
