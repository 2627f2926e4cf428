"""Execution of a plan: motions in one line are joined, and each goes from rest to rest.

A punctual execution keeps the plan's clock. Each of its motions lies in the middle of its planned time, and begins no
earlier; meanwhile the robot stands. For the planning law (:mod:`.laws`) with runs at speed v, ramps of acceleration a
and turns that stand v/2a before and after:

- A run of length L is planned for L/v. It takes L/v + v/a, or 2 sqrt(L/a) <= L/v + v/a if it is shorter than v²/a, so
    in
  the middle it takes at most v/2a of the standing before and after it. A turn takes all but its standing halves. So
  where two runs have a turn, or a hold of v/a, between them, motions in the middle of their times do not overlap.
- The robot is then never more than v²/8a from its planned position, and always on the planned path: at the end of a
    long
  run, plan and robot are v²/2a - v²/8a and v²/2a before the end of ramps, and of a run of u v²/a, u < 1, the distance
  is (u/2)(1 - sqrt(u)/2)² v²/a, which grows with u up to 1/8.
- A run at the start cannot begin v/2a early, unless the plan stands so long before it. It is late by v/2a then, and so
    are
  its successors, until standing makes up for it: at a hold, between two turns, about short runs. No motion is ever
  later, because each begins as soon as its predecessor has ended and its own time has come.

So at time t the robot is at its planned position of that time, or up to v/2a before if the plan begins with a run, with
an error of v²/8a along its path (:class:`Ramps`).
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.math import wrap
from hpop.base.options import LEAST
from hpop.models.laws import Run
from hpop.motions import HOLD, Law, Model, States
from hpop.motions.by_law import extras
from hpop.motions.laws import CLOCK
from hpop.trajectories.trajectory import STRAIGHT, Trajectory

RUN_SAMPLES = 400  # samples of a run's distance, to find when a planned state is passed


class Ramps(NamedTuple):
    """Effect of ramps on a punctual execution.

    half   s  that a plan must stand before and after a run, for the robot to keep its times: v/2a
    stray  m  largest distance ahead of its plan or behind it, along its path: v²/8a
    """

    half: float
    stray: float

    @classmethod
    def of(cls, model: Model) -> Ramps | None:
        """Return the ramps of a model that executes moves as runs; None for other models, with unknown executions."""
        run = model.laws.get(model.executed.get("move", ""))
        if not isinstance(run, Run):
            return None
        return cls(0.5 * run.speed / run.acceleration, run.speed**2 / (8.0 * run.acceleration))


def clearance_radius(model: Model, margin: float) -> float:
    """Return the radius, m, that a robot needs free about its axis.

    Its body, a margin, and its deviation from the plan.
    """
    ramps = Ramps.of(model)
    reach = max((float(part.reach) for part in model.platform), default=0.0)
    return reach + margin + (0.0 if ramps is None else ramps.stray)


def rest_to_rest_execution(planned: Trajectory, executed: Mapping[str, str]) -> tuple[Trajectory, FloatArray]:
    """Return the execution of a trajectory, and the time (n+1,), s, at which each planned state is passed.

    executed  law of execution by planned law; motions of other laws are executed as planned

    Consecutive motions in one line, with an equal turn per metre, become one. Without changes the plan itself is
    returned. A punctual trajectory goes on no earlier than planned.
    """
    if planned.punctual:  # motions planned from rest to rest keep their times
        executed = {kind: becomes for kind, becomes in executed.items() if becomes != kind}
    ends, kinds = _executed_ends(planned, executed)
    if kinds and kinds == planned.kinds:
        return planned, planned.times
    done = Trajectory(planned.model, planned.states.take(np.array(ends)), kinds)
    passed = _passing_times(planned.states, ends, done)
    return _punctual_execution(planned, ends, done, passed) if planned.punctual else (done, passed)


def _punctual_execution(
    planned: Trajectory, ends: list[int], done: Trajectory, passed: FloatArray
) -> tuple[Trajectory, FloatArray]:
    """Return an execution with each motion in the middle of its planned time, or as soon after as possible.

    The robot stands before a motion until its time has come; planned holds do the same.
    """
    times, when = planned.times[ends], passed.copy()
    begins, now = np.zeros(len(done)), 0.0
    for i, (kind, lasts) in enumerate(zip(done.kinds, done.durations.tolist(), strict=True)):
        last = i + 1 == len(done)
        begins[i] = now if kind == HOLD.kind else max(now, 0.5 * (times[i] + times[i + 1] - lasts))
        when[ends[i]] = np.clip(times[i], now, begins[i])  # the robot may stand there
        inside = slice(ends[i] + 1, ends[i + 1] + 1)
        when[inside] = passed[inside] - done.times[i] + begins[i]
        if kind != HOLD.kind:
            now = begins[i] + lasts
        elif last:  # no later motion to wait for
            now = max(now, float(times[i + 1]))
    when[ends[-1]] = now
    return _with_waits(done, begins, now), when


def _with_waits(done: Trajectory, begins: FloatArray, until: float) -> Trajectory:
    """Return the motions of a trajectory without holds, each starting at its time in ``begins`` (n,), s.

    The robot waits between them, and then up to ``until``, s. No wait is shorter than LEAST: a motion begins at most
    that much too early, and no later motion does for that reason.
    """
    moves = [i for i, kind in enumerate(done.kinds) if kind != HOLD.kind]
    lasts, clock = done.durations, getattr(done.states, CLOCK, np.zeros(len(done) + 1))
    rows, kinds, ticks, now = [0], list[str](), [0.0], 0.0
    for i in [*moves, len(done)]:
        waits = (until if i == len(done) else begins[i]) - now
        if waits >= LEAST:
            rows.append(rows[-1])
            kinds.append(HOLD.kind)
            ticks.append(waits)
            now += waits
        if i < len(done):
            rows.append(i + 1)
            kinds.append(done.kinds[i])
            ticks.append(clock[i + 1] - clock[i])
            now += lasts[i]
    states = {**{name: column[rows] for name, column in done.states.__dict__.items()}, CLOCK: np.cumsum(ticks)}
    names = (*done.model.space.names, *extras(done.model, kinds))
    return Trajectory(done.model, States(**{name: states[name] for name in names}), tuple(kinds))


def _executed_ends(planned: Trajectory, executed: Mapping[str, str]) -> tuple[list[int], tuple[str, ...]]:
    """Return the indices (e+1,) of states at which executed motions begin and end, and their kinds (e,)."""
    ends, kinds, laws = [0], list[str](), planned.model.laws
    for i, kind in enumerate(planned.kinds):
        becomes = executed.get(kind)
        if becomes and kinds and kinds[-1] == becomes and _continues(laws[becomes], planned.states, ends[-2], i):
            ends[-1] = i + 1
            continue
        ends.append(i + 1)
        kinds.append(becomes or kind)
    return ends, tuple(kinds)


def _continues(law: Law, states: States, begin: int, i: int) -> bool:
    """Return whether motion i continues the motion that began at state ``begin``; motions in place never do."""
    if not {"x", "y"} <= law.varies:
        return False
    (x0, x1, x2), (y0, y1, y2) = ([getattr(states, axis)[j] for j in (begin, i, i + 1)] for axis in ("x", "y"))
    if (x1, y1) in ((x0, y0), (x2, y2)):  # a motion that goes nowhere has any direction
        return law.varies == {"x", "y"}
    ahead, along = np.arctan2(y2 - y1, x2 - x1), np.arctan2(y1 - y0, x1 - x0)
    if abs(wrap(ahead - along)) >= STRAIGHT:
        return False
    lengths = np.hypot(x1 - x0, y1 - y0), np.hypot(x2 - x1, y2 - y1)
    for name in law.varies - {"x", "y"}:
        before, now, after = (getattr(states, name)[j] for j in (begin, i, i + 1))
        if abs((now - before) / lengths[0] - (after - now) / lengths[1]) >= STRAIGHT:
            return False
    return True


def _passing_times(states: States, ends: list[int], done: Trajectory) -> FloatArray:
    """Return the time at which each planned state is passed: within a run, when its distance is covered."""
    passed = np.zeros(states.size)
    passed[ends] = done.times
    longer = [(motion, *span) for motion, span in enumerate(pairwise(ends)) if span[1] - span[0] > 1]
    moments = [np.linspace(done.times[motion], done.times[motion + 1], RUN_SAMPLES) for motion, _, _ in longer]
    runs = done.at(np.concatenate([*moments, []]))
    for i, (_, first, last) in enumerate(longer):
        run, inside = runs.take(slice(i * RUN_SAMPLES, (i + 1) * RUN_SAMPLES)), np.arange(first + 1, last)
        covered = np.hypot(run.x - run.x[0], run.y - run.y[0])
        travelled = np.hypot(states.x[inside] - run.x[0], states.y[inside] - run.y[0])
        passed[inside] = np.interp(travelled, covered, moments[i])
    return passed
