"""Options of the person aboard: the front of remaining plans, wishes, and the option that the robot takes by itself."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.options import real
from hpop.base.text import shown
from hpop.criteria.base import Criterion, index_of_role
from hpop.criteria.costs import trajectory_costs
from hpop.criteria.visits import Visits
from hpop.drive.moment import Past
from hpop.drive.options import Option, Options, next_turn
from hpop.drive.plan import SAME
from hpop.errors import DriveError, did_you_mean
from hpop.frontier.choices import Preferring
from hpop.frontier.dominance import quantised
from hpop.planners.base import Candidates
from hpop.problems import solving
from hpop.problems.evaluation import claimable
from hpop.problems.front import Front, Point
from hpop.trajectories.motion_table import MotionTable
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem


WHOLE = "worst moments and means are those of the whole drive"


def front_of_rest(
    problem: Problem,
    candidates: Candidates,
    present: Trajectory | None,
    past: Callable[[], Past],
    visits: Visits | None = None,
) -> tuple[Front, Point | None, int | None]:
    """Return the front of remaining plans, a point for a dominated present plan, and the index of the present plan.

    A dominated present plan has the index after the last point of the front. The point is None if the present plan is
    in the front; point and index are None if there is no present plan.

    Costs that are sums cover only the remaining plan, because the past adds the same to all plans. Worst moments and
    means cover the whole drive, so plans with the same values become one point.

    problem  its start and time are those at which the remaining plans begin
    present  the present plan from there, None if an area or a person is in its way
    past     function that returns the costs of the drive up to there
    visits   visits of the present plan, with those that are under way where it begins; None without a tour
    """
    front = solving.front(problem, candidates)
    criteria = [claimable(problem)[name] for name in (*front.names, *front.reported_names)]
    rows = _CostedPlans.of(front)
    if present is None:
        own = _CostedPlans.none(front)
    else:
        values = trajectory_costs(criteria, [present], problem.world)
        if visits is not None and (missed := index_of_role("stops_missed", criteria)) is not None:
            values[:, missed] = visits.missed
        own = _CostedPlans.alone(present, values, problem, visits)
    if any(criterion.aggregate in ("max", "time-mean") for criterion in criteria):
        costs_so_far = past()
        rows, own = (plans.whole(criteria, costs_so_far) for plans in (rows, own))
        front = rows.front(front)
        front = replace(front, certificate=f"{front.certificate}; {WHOLE}")
    if present is None:
        return front, None, None
    place = _place(front, own)
    if place is None and not (front.integers <= _costs_in_quanta(front, own)).all(axis=1).any():
        front = _CostedPlans.of(front).and_those_of(own).front(front)
        place = _place(front, own)
    if place is None:
        return front, own.point(front), len(front)
    items = tuple(present if i == place else trajectory for i, trajectory in enumerate(front.items))
    if problem.tour is not None:  # plans with equal costs may visit the stops in other orders
        own_visits = {"visits": own.origins[0]["visits"]}
        origins = (origin | own_visits if i == place else origin for i, origin in enumerate(front.provenance))
        front = replace(front, provenance=tuple(origins))
    return replace(front, items=items), None, place  # of plans with equal costs, the present one is no change


@dataclass(frozen=True, eq=False)
class _CostedPlans:
    """Remaining plans with their costs and reported values (n, k + r), and their provenance (planner and options)."""

    trajectories: tuple[Trajectory, ...]
    values: FloatArray
    origins: tuple[dict[str, Any], ...]

    @classmethod
    def of(cls, front: Front) -> _CostedPlans:
        """Return the plans of a front."""
        return cls(front.trajectories, np.hstack([front.costs, front.reported]), front.provenance)

    @classmethod
    def alone(cls, present: Trajectory, values: FloatArray, problem: Problem, visits: Visits | None) -> _CostedPlans:
        """Return a collection with only the present plan."""
        origin: dict[str, Any] = {"planner": "drive", "kept": True}
        if problem.tour is not None and visits is not None:
            origin["visits"] = visits.described(problem.tour)
        return cls((present,), values, (origin,))

    @classmethod
    def none(cls, front: Front) -> _CostedPlans:
        """Return an empty collection with the columns of a front."""
        return cls((), np.zeros((0, len(front.names) + len(front.reported_names))), ())

    def and_those_of(self, others: _CostedPlans) -> _CostedPlans:
        """Return a collection of these plans and ``others``."""
        values = np.concatenate([self.values, others.values])
        return _CostedPlans(self.trajectories + others.trajectories, values, self.origins + others.origins)

    def whole(self, criteria: Sequence[Criterion], past: Past) -> _CostedPlans:
        """Return the plans with worst moments and means over the whole drive; ``past`` has the costs so far."""
        if not self.trajectories:
            return self
        values, durations = self.values.copy(), MotionTable.of(self.trajectories).durations
        for j, criterion in enumerate(criteria):
            if criterion.aggregate == "max":
                values[:, j] = np.maximum(values[:, j], past.totals[criterion.name])
            elif criterion.aggregate == "time-mean":
                total = past.duration + durations
                integral = past.totals[criterion.name] + values[:, j] * durations
                values[:, j] = np.divide(integral, total, out=np.zeros(total.size), where=total > 0.0)
        return replace(self, values=values)

    def front(self, like: Front) -> Front:
        """Return the front of these plans, with names, certificate and problem taken from the front ``like``."""
        k = len(like.names)
        return Front.of(
            self.values[:, :k],
            self.trajectories,
            names=like.names,
            units=like.units,
            quanta=like.quanta,
            groups=like.groups,
            reported=self.values[:, k:],
            reported_names=like.reported_names,
            reported_units=like.reported_units,
            status=like.status,
            certificate=like.certificate,
            provenance=self.origins,
            problem=like.problem,
            runs=like.runs,
        )

    def point(self, front: Front) -> Point:
        """Return the only plan as a point, with the index after the last point of a front."""
        values, k = self.values[0].tolist(), len(front.names)
        return Point(
            index=len(front),
            costs=dict(zip(front.names, values[:k], strict=True)),
            reported=dict(zip(front.reported_names, values[k:], strict=True)),
            item=self.trajectories[0],
            provenance=self.origins[0],
        )


def _costs_in_quanta(front: Front, own: _CostedPlans) -> IntArray:
    return quantised(own.values[:, : len(front.names)], front.quanta)


def _place(front: Front, own: _CostedPlans) -> int | None:
    """Return the index of the point of a front that has the same costs as a plan; None if there is none."""
    same = np.flatnonzero((front.integers == _costs_in_quanta(front, own)).all(axis=1))
    return int(same[0]) if same.size else None


SHARE = 0.2
"""Default share by which other costs may grow in a hurry."""
HURRY = "hurry"
LESS = re.compile(r"(?:fewer|less)\s+(.+)")


@dataclass(frozen=True)
class Wish:
    """Answer to a wish of the person aboard.

    option  the option that meets the wish, None if none does
    words   description of the choice, or the reason why there is none
    """

    option: Option | None
    words: str


def wished(options: Options, wish: str | None, shares: Mapping[str, Any]) -> Wish:
    """Return the option that meets a wish with the least loss in the other costs.

    - "fewer turns", "less exposure": less of that cost than the remaining plan, with the least loss in other costs.
    - "hurry": the least duration, if it is less than that of the remaining plan, among options in which no other cost
      grows by more than its share in ``shares``, or by more than a fifth if it has no share there.
    - ``wish`` None and shares, such as ``duration=-0.2``: each named cost grows by at most its share (here it falls by
      a fifth or more), with the least loss.

    The loss is the sum over the costs above those of the remaining plan: their growth, each divided by the range of the
    cost over the options. Costs that fall do not reduce the loss; they only decide between equal losses.
    Raises DriveError for an unknown wish, and for a cost that the front does not have.
    """
    checked = checked_wish(wish, shares, options.front.names)
    if options.keep_on is None:
        return Wish(
            None,
            "a wish refers to the remaining plan, but a closed area or a person is in its way; take one of the options",
        )
    if checked.name is not None:
        return _less(options, checked.name)
    return _within(options, checked.shares) if wish is None else _hurry(options, checked.shares)


class _CheckedWish(NamedTuple):
    """A valid wish.

    name    name of the cost to reduce, None if the wish names none
    shares  by name of a cost, its largest growth, as a share of the remaining plan's cost
    """

    name: str | None
    shares: dict[str, float]


def checked_wish(wish: Any, shares: Mapping[str, Any], names: Sequence[str]) -> _CheckedWish:
    """Check a wish of :func:`wished` against the names of the costs, and return it; DriveError if it is invalid."""
    limits = {name: real(f"the wish for {name}", share, -1, 100, "a share") for name, share in shares.items()}
    for name in limits:
        _check(name, names)
    if wish is None:
        if not limits:
            raise DriveError(
                "a wish must be words, such as 'fewer turns' or 'hurry', or a cost and a share: duration=-0.2"
            )
        return _CheckedWish(None, limits)
    if not isinstance(wish, str):
        raise DriveError(f"a wish must be words, such as 'fewer turns', got {shown(wish)}")
    if wish == HURRY:
        return _CheckedWish(None, limits)
    match = LESS.fullmatch(wish.strip())
    if match is None:
        raise DriveError(
            f"a wish must be 'hurry', or a text such as 'fewer {names[0]}'; got {shown(wish)}. Costs are "
            f"{', '.join(names)}.{did_you_mean(wish, [HURRY, *(f'fewer {name}' for name in names)])}"
        )
    if limits:
        raise DriveError(
            f"the wish {shown(wish)} cannot be combined with changes of costs, such as duration=-0.2 (a fifth less). "
            f"Give the wish alone, or the changes alone; only '{HURRY}' may have both"
        )
    name = match.group(1)
    _check(name, names)
    return _CheckedWish(name, {})


def _check(name: str, names: Sequence[str]) -> None:
    if name not in names:
        raise DriveError(
            f"there is no cost {shown(name)} to wish for.{did_you_mean(name, names)} The front has the costs "
            f"{', '.join(names)}; for another cost, plan with that criterion as well"
        )


def _less(options: Options, name: str) -> Wish:
    counts, plan = _counts(options)
    j = options.front.names.index(name)
    able = counts[:, j] < plan[j]
    return _least_loss(options, able, f"with less {name} than the remaining plan")


def _within(options: Options, limits: Mapping[str, float]) -> Wish:
    counts, plan = _counts(options)
    able = np.ones(len(counts), dtype=np.bool_)
    for name, share in limits.items():
        j = options.front.names.index(name)
        able &= counts[:, j] <= plan[j] * (1.0 + share) + 1e-9
    words = " and ".join(f"at most {1.0 + share:.3g} times the {name}" for name, share in limits.items())
    return _least_loss(options, able, f"with {words} of the remaining plan")


def _hurry(options: Options, limits: Mapping[str, float]) -> Wish:
    names = options.front.names
    if "duration" not in names:
        return Wish(
            None,
            "the front has no cost 'duration', so no option is known to be quicker; plan with that criterion as well",
        )
    counts, plan = _counts(options)
    able = np.ones(len(counts), dtype=np.bool_)
    for j, name in enumerate(names):
        if name != "duration":
            able &= counts[:, j] <= plan[j] * (1.0 + limits.get(name, SHARE)) + 1e-9
    j = names.index("duration")
    able &= counts[:, j] < plan[j]
    if not able.any():
        return Wish(None, "every quicker option raises another cost by more than its share")
    rows = np.flatnonzero(able)
    return _chosen(options, int(rows[np.argmin(counts[rows, j])]), "the quickest option within the shares")


def _least_loss(options: Options, able: BoolArray, words: str) -> Wish:
    """Return the option with the least growth of costs over the remaining plan, among the options ``able`` (n,).

    The growth of each cost is divided by its range over the options; costs that fall count only if several options
    have the least growth. ``words`` describe the condition.
    """
    if not able.any():
        return Wish(None, f"there is no option {words}")
    counts, plan = _counts(options)
    span = np.ptp(np.concatenate([counts, plan[None]]), axis=0)
    growth = np.divide(counts - plan, span, out=np.zeros(counts.shape), where=span > 0)
    rows = np.flatnonzero(able)
    losses = np.maximum(growth[rows], 0.0).sum(axis=1)
    gains = np.maximum(-growth[rows], 0.0).sum(axis=1)
    best = int(rows[np.lexsort((-gains, np.round(losses, 12)))[0]])
    return _chosen(options, best, f"the least loss {words}")


def _chosen(options: Options, row: int, words: str) -> Wish:
    option: Option = options[row]
    plan = _plan_of(options)
    counts, own = _counts(options)
    changes = [
        f"{name} {value - plan[name]:+.4g} {unit}".removesuffix(" 1")
        for (name, value), unit, changed in zip(
            option.costs.items(), options.front.units, counts[row] != own, strict=True
        )
        if changed
    ]
    return Wish(option, f"{words}: {', '.join(changes) or 'the present plan'}")


def _plan_of(options: Options) -> Mapping[str, float]:
    """Return the costs of the remaining plan, by name of the criterion."""
    assert options.keep_on is not None
    costs: Mapping[str, float] = options[options.keep_on].costs
    return costs


def _counts(options: Options) -> tuple[Any, Any]:
    """Return the costs (n, k) of the points of the front, and (k,) of the remaining plan, in quanta (cost steps)."""
    front = options.front
    plan = np.array([_plan_of(options)[name] for name in front.names])
    return front.integers.astype(np.float64), np.rint(plan / front.quanta)


PATIENCE = 0.1
"""Default share by which an option must be better before the robot takes it by itself."""
NOTICE = 2.0
"""Default time, s, between a change by the robot itself and the first turn that was not announced."""


def adapted(options: Options, patience: float, notice: float, preference: Preferring | None = None) -> Option | None:
    """Return the option that a robot takes by itself; None if it keeps its plan or has no option.

    If the remaining plan cannot be driven to its end (a closed area or a person is in its way), this is the option that
    ``preference`` prefers; without a preference, the knee of the front (the best compromise). Otherwise each option is
    compared with the remaining plan: by the ratio of their expected costs for the preference; without one, by the ratio
    of their costs, averaged over the criteria. The robot takes the option with the least ratio in which no unannounced
    turn begins within ``notice``, s, if this ratio is at most 1 - ``patience``.
    """
    if not len(options.front):
        return None
    if options.keep_on is None:
        return options.knee() if preference is None else options.select(preference=preference)
    plan = np.array([options[options.keep_on].costs[name] for name in options.front.names])
    costs = options.front.costs
    if preference is not None:
        plan, costs = (preference.expected(options.front, of)[:, None] for of in (plan[None], costs))
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(plan > 0, costs / plan, np.where(costs > 0, np.inf, 1.0)).mean(axis=1)
    for row in np.argsort(shares, kind="stable").tolist():
        if shares[row] > 1.0 - patience:
            return None
        option: Option = options[row]
        if option.keeps_on or option.leaves_at is None:
            continue
        t = option.leaves_at - options.commit.time
        turn = next_turn(option.item, t - 2 * SAME)
        if turn is None or options.commit.time + turn - options.now >= notice:
            return option
    return None
