"""Wishes of the person aboard: the option that meets a wish, and the option that the robot takes by itself."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray
from hpop.base.options import real
from hpop.base.text import shown
from hpop.drive.options import Option, Options, next_turn
from hpop.drive.plan import SAME
from hpop.errors import DriveError, did_you_mean
from hpop.frontier.choices import Preferring

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
            f"a wish must be 'hurry', or 'fewer' or 'less' with a cost ({', '.join(names)}), got {shown(wish)}."
            f"{did_you_mean(wish, [HURRY, *(f'fewer {name}' for name in names)])}"
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
