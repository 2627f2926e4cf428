"""What a robot changes by itself: with patience, and only what nobody is surprised by."""

from __future__ import annotations

import numpy as np

from hpop.drive.departures import next_turn
from hpop.drive.options import Option, Options
from hpop.drive.plan import SAME

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
