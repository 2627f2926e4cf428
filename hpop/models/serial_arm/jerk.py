"""Jerk-limited execution of an arm's reaches, for controllers that refuse jumps of the acceleration.

The share of a reach grows from rest to rest with a constant jerk in each of seven phases (Biagiotti and Melchiorri
2008, Trajectory Planning for Automatic Machines and Robots, section 3.4). In each phase the joints are cubic functions
of time, so the result is a trajectory of splines. Its path is that of the reaches, which was proved free of collisions.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.options import MOST, real
from hpop.base.text import shown
from hpop.errors import OptionError, did_you_mean
from hpop.models.serial_arm.laws import Reach, rate_of
from hpop.motions import HOLD, States
from hpop.motions.by_law import extras
from hpop.motions.laws import CLOCK
from hpop.trajectories.trajectory import Trajectory

LEAST_JERK = 1e-3  # rad/s³ or m/s³
SHORT = 1e-9  # s: shorter phases are left out
Jerk = float | Mapping[str, float]


class _Executed(NamedTuple):
    """Jerk-limited trajectory, and the times (n+1,), s, at which it passes the n+1 states of the planned one."""

    trajectory: Trajectory
    passed: FloatArray


@checked_arguments
def jerk_limited(trajectory: Trajectory, jerk: Jerk) -> _Executed:
    """Return a trajectory along the same path, slowed down so that no joint exceeds its largest jerk.

    The times at which it passes the planned states are returned too.

    trajectory  reaches of a serial arm, and holds
    jerk        rad/s³ or m/s³, largest jerk of all joints, or of each by name

    Speeds and accelerations keep the limits of the arm. Raises OptionError for another robot, for other motions, which
    are not from rest to rest, and for a jerk that is no positive number.
    """
    law = trajectory.model.laws.get("reach")
    if not isinstance(law, Reach) or "spline" not in trajectory.model.provides:
        raise OptionError("jerk limits need a serial_arm, got another robot; leave the jerk out")
    reaches = {kind: each for kind, each in trajectory.model.laws.items() if isinstance(each, Reach)}
    if other := sorted({*trajectory.kinds} - {*reaches, HOLD.kind}):
        raise OptionError(
            f"jerk limits need reaches, which begin and end at rest, got {', '.join(other)}, whose acceleration jumps "
            "between motions, however slow they are; export a trajectory of the planner roadmap, or leave the jerk out"
        )
    most = _checked_jerk(jerk, law.names)
    rows = np.stack([getattr(trajectory.states, name) for name in law.names], axis=1)
    knots, rates, times, passed = [rows[0]], [np.zeros(len(most))], [0.0], [0.0]
    kinds: list[str] = []
    for i, kind in enumerate(trajectory.kinds):
        change, lasts = rows[i + 1] - rows[i], float(trajectory.durations[i])
        if kind == HOLD.kind:
            shares = [(lasts, 1.0, 0.0)]
        else:
            size = np.abs(change)
            limits = (np.divide(limit, size, out=np.full(size.size, np.inf), where=size > 0) for limit in
                      (np.array(reaches[kind].speeds), np.array(law.accelerations), most))  # fmt: skip
            shares = _share_knots(*(float(each.min()) for each in limits)) if size.any() else []
        for lasted, share, speed in shares:
            knots.append(rows[i + 1] if share == 1.0 else rows[i] + share * change)
            rates.append(speed * change)
            times.append(times[-1] + lasted)
            kinds.append(kind if kind == HOLD.kind else "spline")
        passed.append(times[-1])
    columns = dict(zip(law.names, np.array(knots).T, strict=True))
    columns |= dict(zip(map(rate_of, law.names), np.array(rates).T, strict=True)) | {CLOCK: np.array(times)}
    names = (*trajectory.model.space.names, *extras(trajectory.model, kinds))
    states = States(**{name: columns[name] for name in names})
    return _Executed(Trajectory(trajectory.model, states, tuple(kinds), trajectory.punctual), np.array(passed))


def _share_knots(speed: float, acceleration: float, jerk: float) -> list[tuple[float, float, float]]:
    """Return the phases of a motion in which the share of the way done grows from 0 to 1, from rest to rest.

    Each has its duration, s, and the share and its speed, 1/s, at the end. Limits are those of the share: 1/s, 1/s²
    and 1/s³.
    """
    ramp = min(acceleration / jerk, (speed / jerk) ** 0.5)  # time in which the acceleration grows
    speeding = ramp + (speed / acceleration if speed * jerk > acceleration**2 else ramp)
    cruise = 1.0 / speed - speeding
    if cruise < 0.0:  # the share never reaches its largest speed
        cruise, ramp = 0.0, min(acceleration / jerk, (0.5 / jerk) ** (1 / 3))
        speeding = max(2.0 * ramp, 0.5 * ramp + (0.25 * ramp**2 + 1.0 / (jerk * ramp)) ** 0.5)
    found, share, rate, push = [], 0.0, 0.0, 0.0
    steady = speeding - 2.0 * ramp
    for lasts, sign in zip([ramp, steady, ramp, cruise, ramp, steady, ramp], [1, 0, -1, 0, -1, 0, 1], strict=True):
        change = sign * jerk
        share += lasts * (rate + lasts * (push / 2.0 + lasts * change / 6.0))
        rate += lasts * (push + lasts * change / 2.0)
        push += lasts * change
        if lasts > SHORT:
            found.append((lasts, share, rate))
    found[-1] = (found[-1][0], 1.0, 0.0)  # exactly
    return found


def _checked_jerk(jerk: Jerk, names: tuple[str, ...]) -> FloatArray:
    """Return the largest jerk (n,) of each joint; raise OptionError for an unknown joint, a missing or wrong number."""
    if isinstance(jerk, Mapping):
        if unknown := [name for name in jerk if name not in names]:
            hint = did_you_mean(unknown[0], names)
            raise OptionError(
                f"jerk names {shown(unknown[0])}, which is no joint that moves.{hint} Name {', '.join(names)}"
            )
        if missing := [name for name in names if name not in jerk]:
            raise OptionError(f"jerk must name every joint that moves, got none for {', '.join(missing)}; add them")
        given = [jerk[name] for name in names]
    else:
        given = [jerk] * len(names)
    return np.array([real("jerk", value, LEAST_JERK, MOST, "rad/s³ or m/s³,") for value in given], float)
