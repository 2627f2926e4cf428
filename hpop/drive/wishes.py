"""Wishes: what a person aboard wants, as a choice among the options. Same costs, another preference."""

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

SHARE = 0.2
"""By how much, as a share, other costs may grow where somebody is in a hurry and does not say."""
HURRY = "hurry"
LESS = re.compile(r"(?:fewer|less)\s+(.+)")


@dataclass(frozen=True)
class Wish:
    """What became of a wish.

    option  that fulfils it, None where none does
    words   what was chosen, or why nothing was
    """

    option: Option | None
    words: str


def wished(options: Options, wish: str | None, shares: Mapping[str, Any]) -> Wish:
    """The option that fulfils a wish with the least loss in the other costs.

    - "fewer turns", "less exposure": less of a cost than the rest of the plan has, at the least loss in the others.
    - "hurry": the least duration of those whose other costs grow by no more than a fifth; of each cost that ``shares``
      names by as much as that says.
    - no words, ``duration=-0.2``: a cost that changes by at least that share (here: a fifth less), at the least loss.

    A loss is what costs grow by over the rest of the plan, each as a part of its range over the options. Raises
    DriveError for a wish for a cost that is none of the front's, and for what is no wish.
    """
    asked = checked_wish(wish, shares, options.front.names)
    if options.keep_on is None:
        return Wish(None, "a wish is measured by the rest of the plan, which is closed; take one of the options")
    if asked.name is not None:
        return _less(options, asked.name)
    return _within(options, asked.shares) if wish is None else _hurry(options, asked.shares)


class _Asked(NamedTuple):
    """A wish that makes sense.

    name    of the cost of which there is to be less, None where none is named
    shares  by which costs may grow at most
    """

    name: str | None
    shares: dict[str, float]


def checked_wish(wish: Any, shares: Mapping[str, Any], names: Sequence[str]) -> _Asked:
    """A wish as :func:`wished` takes it, for one of the costs of these names; raises DriveError for what is none."""
    limits = {name: real(f"the wish for {name}", share, -1, 100, "a share") for name, share in shares.items()}
    for name in limits:
        _check(name, names)
    if wish is None:
        if not limits:
            raise DriveError("a wish is words, such as 'fewer turns' or 'hurry', or a cost and a share: duration=-0.2")
        return _Asked(None, limits)
    if not isinstance(wish, str):
        raise DriveError(f"a wish is words, such as 'fewer turns', got {shown(wish)}")
    if wish == HURRY:
        return _Asked(None, limits)
    match = LESS.fullmatch(wish.strip())
    if match is None:
        raise DriveError(
            f"a wish is 'hurry', or 'fewer' or 'less' with a cost ({', '.join(names)}), got {shown(wish)}."
            f"{did_you_mean(wish, [HURRY, *(f'fewer {name}' for name in names)])}"
        )
    if limits:
        raise DriveError(f"{shown(wish)} takes no shares; say duration=-0.2 alone, or 'hurry' with them")
    name = match.group(1)
    _check(name, names)
    return _Asked(name, {})


def _check(name: str, names: Sequence[str]) -> None:
    if name not in names:
        raise DriveError(
            f"there is no cost {shown(name)} to wish for.{did_you_mean(name, names)} The front's are "
            f"{', '.join(names)}; for another one plan with that criterion as well"
        )


def _less(options: Options, name: str) -> Wish:
    counts, plan = _counts(options)
    j = options.front.names.index(name)
    able = counts[:, j] < plan[j]
    return _least_loss(options, able, f"with less {name} than the rest of the plan")


def _within(options: Options, limits: Mapping[str, float]) -> Wish:
    counts, plan = _counts(options)
    able = np.ones(len(counts), dtype=np.bool_)
    for name, share in limits.items():
        j = options.front.names.index(name)
        able &= counts[:, j] <= plan[j] * (1.0 + share) + 1e-9
    said = " and ".join(f"at most {1.0 + share:.3g} times the {name}" for name, share in limits.items())
    return _least_loss(options, able, f"with {said} of the rest of the plan")


def _hurry(options: Options, limits: Mapping[str, float]) -> Wish:
    names = options.front.names
    if "duration" not in names:
        return Wish(None, "'duration' is no cost of the front, so nothing tells what is quicker; plan with it as well")
    counts, plan = _counts(options)
    able = np.ones(len(counts), dtype=np.bool_)
    for j, name in enumerate(names):
        if name != "duration":
            able &= counts[:, j] <= plan[j] * (1.0 + limits.get(name, SHARE)) + 1e-9
    j = names.index("duration")
    able &= counts[:, j] < plan[j]
    if not able.any():
        return Wish(None, "no option is quicker without other costs that grow by more than was asked for")
    rows = np.flatnonzero(able)
    return _chosen(options, int(rows[np.argmin(counts[rows, j])]), "the quickest whose other costs grow by so little")


def _least_loss(options: Options, able: BoolArray, said: str) -> Wish:
    """Of the options of a mask (n,) the one whose costs grow least, each as a part of its range."""
    if not able.any():
        return Wish(None, f"there is no option {said}")
    counts, plan = _counts(options)
    span = np.ptp(np.concatenate([counts, plan[None]]), axis=0)
    growth = np.divide(counts - plan, span, out=np.zeros(counts.shape), where=span > 0)
    rows = np.flatnonzero(able)
    losses = np.maximum(growth[rows], 0.0).sum(axis=1)
    gains = np.maximum(-growth[rows], 0.0).sum(axis=1)
    best = int(rows[np.lexsort((-gains, np.round(losses, 12)))[0]])
    return _chosen(options, best, f"the least loss {said}")


def _chosen(options: Options, row: int, said: str) -> Wish:
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
    return Wish(option, f"{said}: {', '.join(changes) or 'the present plan'}")


def _plan_of(options: Options) -> Mapping[str, float]:
    """What the rest of the plan costs."""
    assert options.keep_on is not None
    costs: Mapping[str, float] = options[options.keep_on].costs
    return costs


def _counts(options: Options) -> tuple[Any, Any]:
    """Costs (n, k) of the front's points, and (k,) of the rest of the plan, in whole quanta."""
    front = options.front
    plan = np.array([_plan_of(options)[name] for name in front.names])
    return front.integers.astype(np.float64), np.rint(plan / front.quanta)


PATIENCE = 0.1
"""By how much, as a share, another way must be better for the robot to take it by itself."""
NOTICE = 2.0
"""s before the first turn that nobody was told of, at least, where the robot changes its plan by itself."""


def adapted(options: Options, patience: float, notice: float) -> Option | None:
    """The option that a robot takes by itself; None where it keeps its plan, or where there is none.

    Where the plan is closed, it is the knee. Else the option with the least share of the plan's rest, on the mean over
    the costs, if that is better by ``patience``, and no turn that nobody was told of begins within ``notice``, s.
    """
    if not len(options.front):
        return None
    if options.keep_on is None:
        return options.knee()
    plan = np.array([options[options.keep_on].costs[name] for name in options.front.names])
    costs = options.front.costs
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
