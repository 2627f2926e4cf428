"""What a robot does of what was planned: motions in one line are one, and each goes from rest to rest."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from hpop.arrays import FloatArray
from hpop.math import wrap
from hpop.motions import Law, States
from hpop.trajectory import STRAIGHT, Trajectory

RUN_SAMPLES = 400  # moments of a run at which the distance covered is known, to find when a planned state is passed


def rest_to_rest_execution(planned: Trajectory, executed: Mapping[str, str]) -> tuple[Trajectory, FloatArray]:
    """What is done of a trajectory, and the time (n+1,), s, at which each planned state is passed.

    executed  the law by which the motions of a planned law are done; motions of others are done as planned

    Consecutive motions that go on in one line, and turn on it as much a metre, become one. Where nothing changes, what
    is planned is what is done.
    """
    ends, kinds = _runs(planned, executed)
    if kinds and kinds == planned.kinds:
        return planned, planned.times
    done = Trajectory(planned.model, planned.states.take(np.array(ends)), kinds)
    return done, _passed(planned.states, ends, done)


def _runs(planned: Trajectory, executed: Mapping[str, str]) -> tuple[list[int], tuple[str, ...]]:
    """Places of the states (e+1,) at which the executed motions begin and end, and their kinds (e,)."""
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
    """Whether motion i goes on as the one that began at state ``begin`` does; what stays in its place never does."""
    if not {"x", "y"} <= law.varies:
        return False
    (x0, x1, x2), (y0, y1, y2) = ([getattr(states, axis)[j] for j in (begin, i, i + 1)] for axis in ("x", "y"))
    if (x1, y1) in ((x0, y0), (x2, y2)):  # one of them goes nowhere, so in any direction
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


def _passed(states: States, ends: list[int], done: Trajectory) -> FloatArray:
    """When each planned state is passed: between the ends of a run, as soon as it has come so far."""
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
