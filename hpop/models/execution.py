"""Execution of a plan: the motion that a robot really makes for a planned trajectory.

Moves in one straight line are joined, and each motion then goes from rest to rest.

A plan with moving people is punctual: its execution must keep the times of the plan. Each executed motion then lies in
the middle of its planned time and begins no earlier; the robot stands until then. Let v be the speed of a run (a
straight move from rest to rest), a its acceleration, and let planned turns include a wait of v/2a before and after
(:mod:`.laws`). Then:

- A run of length L is planned for L/v. It really takes L/v + v/a, or 2 sqrt(L/a) <= L/v + v/a if L < v²/a. Centred on
  its planned time, it begins at most v/2a early and ends at most v/2a late. A turn does not use its planned waits of
  v/2a. So if a turn, or a hold of v/a, is between any two runs, executed motions do not overlap.
- The robot is then never more than v²/8a from its planned position, and always on the planned path. At the planned end
  of a long run, the plan is at the end of the run and the robot v²/8a before it. For a run of length u v²/a with u < 1
  the distance is (u/2)(1 - sqrt(u)/2)² v²/a, which grows with u up to v²/8a.
- A run at the start of the plan cannot begin v/2a early, unless the plan stands that long before it. It is then late by
  v/2a, and so are the motions after it, until a wait makes up for it: at a hold, between two turns, or about short
  runs. No motion is ever later than that, since each begins once its predecessor has ended and its own time has come.

So at time t the robot is at its planned position for t, or for a time up to v/2a before t if the plan begins with a
run, with an error of v²/8a along its path (:class:`Ramps`).
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.math import wrap
from hpop.base.options import LEAST
from hpop.models.laws import Run
from hpop.motions import HOLD, Law, Model, States
from hpop.motions.by_law import extras
from hpop.motions.laws import CHANGE, CLOCK
from hpop.trajectories.trajectory import STRAIGHT, Trajectory

RUN_SAMPLES = 400  # samples of the distance covered in a run, to find when planned states are passed


class Ramps(NamedTuple):
    """Effect of speeding up and slowing down on an execution that must keep the times of its plan.

    half   s  v/2a: wait that a plan needs before and after each run, so that the robot can keep the times
    stray  m  v²/8a: largest distance along the path between the robot and its planned position
    """

    half: float
    stray: float

    @classmethod
    def of(cls, model: Model) -> Ramps | None:
        """Return the ramps of a model that executes moves as :class:`Run`, or steers; None for other models.

        ``half`` is 0 for a base with several speeds, and for one that steers: the changes of speed in its plans, or
        the stops about its runs, take this time already.
        """
        if model.speed_classes and CHANGE in model.laws:
            change: Any = model.laws[CHANGE]
            return cls(0.0, model.speed_classes[-1] ** 2 / (8.0 * change.acceleration))
        if "steering" in model.provides:
            ramp: Any = model.laws[next(iter(model.executed.values()))]
            return cls(0.0, ramp.speed**2 / (8.0 * ramp.acceleration))
        run = model.laws.get(model.executed.get("move", ""))
        if not isinstance(run, Run):
            return None
        return cls(0.5 * run.speed / run.acceleration, run.speed**2 / (8.0 * run.acceleration))


def clearance_radius(model: Model, margin: float) -> float:
    """Return the radius, m, of the circle about its axis that a robot needs free while it executes a plan.

    It is the reach of the body, plus a margin, m, plus the largest deviation from the plan (:class:`Ramps`).
    """
    ramps = Ramps.of(model)
    reach = max((float(part.reach) for part in model.platform), default=0.0)
    return reach + margin + (0.0 if ramps is None else ramps.stray)


def rest_to_rest_execution(planned: Trajectory, executed: Mapping[str, str]) -> tuple[Trajectory, FloatArray]:
    """Return the execution of a trajectory, and the times (n+1,), s, at which it passes the planned states.

    executed  the kind of law that executes each planned kind; motions of other kinds are executed as planned

    Consecutive motions along one straight line become one motion if they turn by equal angles per metre. If nothing
    changes, the plan itself is returned. In the execution of a plan that must keep its times (``punctual``), no
    motion begins before its planned time.
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
    """Return an execution in which each motion lies in the middle of its planned time, or as soon after as possible.

    ends    indices of the planned states at which the executed motions begin and end
    done    the executed motions without waits
    passed  s, times at which ``done`` passes the planned states

    Waits are inserted before motions that would begin too early. Also return the times at which the execution passes
    the planned states.
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
    """Return a trajectory in which the motions of ``done`` other than holds begin at given times.

    begins  (n,)  s, time at which each motion begins
    until   s, time until which the robot stands after the last motion

    Between motions the robot waits. A wait shorter than ``LEAST`` is left out: a motion may begin that much too early,
    but these errors do not add up.
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
    """Return the planned states between which executed motions lead, as indices (e+1,), and their kinds (e,).

    Consecutive planned moves in one straight line become one executed motion.
    """
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
    """Return whether motion i continues, in one straight line, the executed motion that began at state ``begin``.

    Other states that ``law`` changes, such as a yaw, must change equally per metre in both. Motions in place never
    continue another.
    """
    if not {"x", "y"} <= law.varies:
        return False
    (x0, x1, x2), (y0, y1, y2) = ([getattr(states, axis)[j] for j in (begin, i, i + 1)] for axis in ("x", "y"))
    if (x1, y1) in ((x0, y0), (x2, y2)):  # a motion of length 0 fits any direction
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
    """Return the times (n+1,), s, at which an execution passes the planned states.

    A planned state within a longer run is passed when the run has covered its distance from the start of the run.
    """
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
