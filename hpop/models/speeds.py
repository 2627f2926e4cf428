r"""Speed classes of a base: straight moves at one of several speeds, changes between them, and their execution.

A model with classes v1 < v2 < ... < vk has these laws instead of one cruise speed. Its states have one more column,
``speed`` (m/s): the speed at which the base is at that moment of the plan, 0 or one of the classes.

- :class:`MoveAtSpeed`: a straight move of length L at speed v lasts L/v.
- :class:`SpeedChange` from speed u to w lasts \|w - u\|/2a, in place: the plan stands meanwhile. It leads from rest to
  any class, from any class to rest, or to a neighbouring class.
- Turns and other motions in place begin and end at rest, so they need no loss of their own.

Why \|w - u\|/2a? A ramp from u to w takes \|w - u\|/a, and \|w - u\|/2a is what a ramp to or from rest loses against a
move at speed w. Starting to v and stopping again lose v/a together, which is the loss that a turn has by the planning
law for one speed (:mod:`.laws`). These times add up: from rest to v2 takes the time of rest to v1 to v2.

The execution drives each straight run from rest to rest, as fast as possible: nowhere faster than the planned class,
with an acceleration of at most a. It accelerates behind a change to a faster class, and brakes before a change to a
slower one. It never lasts longer than the plan. Proof: between two cruises at u and w, or rest, the execution speeds up
to some p and slows down again, on a way of D = (2p² - u² - w²)/2a metres in (2p - u - w)/a seconds. Let m >= p be the
fastest class there. The plan takes at least D/m + (2m - u - w)/2a. This grows with m, and for m = p it is longer than
the execution by (u (p - u) + w (p - w))/2ap: by nothing from and to rest, by 1/8 s from 0.5 to 1 m/s at 1 m/s².
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray, IntArray
from hpop.base.math import smooth_abs
from hpop.base.options import LEAST, MOST, real
from hpop.base.text import shown
from hpop.errors import ModelError
from hpop.models.laws import InPlaceGeometry, Move, StraightGeometry, linear
from hpop.motions import HOLD, Law, Model, Phase, States, laws_of
from hpop.motions.by_law import extras
from hpop.motions.laws import CHANGE, CLOCK, SPEED
from hpop.trajectories.trajectory import STRAIGHT, Trajectory

MOST_CLASSES = 8
SLOW = 1e-9  # m/s: below, the speed of a ramp has no usable slope along its way
SAME = 1e-6  # m/s or m/s²: tolerance for speeds that were rounded to decimals


@dataclass(frozen=True)
class MoveAtSpeed(Move):
    """Straight move at the speed of its states.

    speed  m/s  fastest class, for states without the column ``speed``
    """

    extra: ClassVar[tuple[str, ...]] = (SPEED,)

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return one phase at constant speed."""
        duration = self.travel(start, end, 0.0) / (start.speed if SPEED in start.names else self.speed)
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "cruise"),)


@dataclass(frozen=True)
class SpeedChange(InPlaceGeometry):
    """Change of speed in place, at the model's acceleration, m/s²."""

    acceleration: float
    kind: str = CHANGE

    varies = frozenset({SPEED})
    extra: ClassVar[tuple[str, ...]] = (SPEED,)

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return one phase in which the speed changes evenly.

        It lasts half of the change divided by the acceleration; the module's text says why.
        """
        duration = 0.5 * smooth_abs(end.speed - start.speed) / self.acceleration
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "cruise"),)


@dataclass(frozen=True)
class SpeedRamp(StraightGeometry):
    """Executed straight motion with constant acceleration, from the speed of its start to that of its end."""

    kind: str = "run"

    varies = frozenset({"x", "y", SPEED})
    extra: ClassVar[tuple[str, ...]] = (SPEED,)

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return one phase, in which the speed grows or falls evenly with time."""
        total = start.speed + end.speed
        positive = total > 0
        safe = np.where(positive, total, 1.0)
        duration = np.where(positive, 2.0 * self.travel(start, end, 0.0) / safe, 0.0)
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "ramp", (end.speed - start.speed) / safe),)

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """Return the column ``name`` after a share (0 to 1) of the way; the squared speed grows evenly along it."""
        if name == SPEED:
            return np.sqrt(np.maximum(start.speed**2 + (end.speed**2 - start.speed**2) * share, 0.0))
        return linear(name, start, end, share)

    def slopes(self, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
        """Return the first and second derivatives of a state with respect to the share of the way."""
        if name != SPEED:
            return getattr(end, name) - getattr(start, name), 0.0
        speed = self.interpolate(SPEED, start, end, share)
        grows, moves = 0.5 * (end.speed**2 - start.speed**2), speed > SLOW
        slope = np.where(moves, grows / np.where(moves, speed, 1.0), 0.0)
        return slope, -np.where(moves, slope**2 / np.where(moves, speed, 1.0), 0.0)

    def strays(self, start: States, end: States) -> Column:
        """Return 0 (M,) for possible speeds; inf if one is negative, or if both are 0 although the base moves."""
        wrong = (start.speed < 0) | (end.speed < 0)
        wrong |= (start.speed + end.speed <= 0) & (self.travel(start, end, 0.0) > SAME)
        return np.where(wrong, np.inf, 0.0)


def speed_laws(speeds: Sequence[float], acceleration: float) -> dict[str, Law]:
    """Return three laws of a base with speed classes: planned moves, planned changes of speed, and executed moves.

    speeds        m/s, rising
    acceleration  m/s²
    """
    return {
        "move": MoveAtSpeed(float(speeds[-1])),
        CHANGE: SpeedChange(float(acceleration)),
        "run": SpeedRamp(),
    }


def checked_speeds(speeds: Any, least: float, name: str = "speeds", unit: str = "m/s") -> tuple[float, ...]:
    """Return the speed classes, rising, from a number or a list of numbers; raise ModelError for others.

    name, unit  the option with the classes, and their unit, for messages
    """
    given: Any = [speeds] if isinstance(speeds, int | float | np.number) else speeds
    kind = name.replace("_", " ")
    wrong = f"{name} must be one number, or a list of up to {MOST_CLASSES} rising {kind} in {unit}, got {shown(speeds)}"
    given = given.tolist() if isinstance(given, np.ndarray) else given
    if not isinstance(given, list | tuple) or not 1 <= len(given) <= MOST_CLASSES:
        raise ModelError(wrong)
    values = tuple(float(real(name, v, least, MOST, f"{kind} in {unit}, each", error=ModelError)) for v in given)
    if any(b <= a for a, b in pairwise(values)):
        raise ModelError(f"{wrong}; sort them, and give each once")
    return values


# Execution


def class_execution(planned: Trajectory, executed: Mapping[str, str]) -> tuple[Trajectory, FloatArray]:
    """Return the execution of a plan with speed classes, and the time (n+1,), s, at which each planned state is passed.

    executed  law of execution by planned law, "run" for moves; motions of other laws are executed as planned

    In the execution of a plan that must keep its times (``punctual``), each straight run from rest to rest lies in the
    middle of its planned time.
    """
    laws, kinds = laws_of(planned.model), planned.kinds
    if not {*executed, CHANGE} & {*kinds}:  # it is executed as planned
        return planned, planned.times
    spaced = {name: getattr(planned.states, name) for name in planned.model.space.names}
    columns: dict[str, list[FloatArray]] = {name: [column[:1]] for name, column in spaced.items()}
    speeds, done, held = [np.zeros(1)], list[str](), [np.zeros(1)]
    passed_in = np.zeros((planned.states.size, 3))  # executed motion, way in it, speed at its start
    motions, i = 0, 0

    def add_wait(row: int, lasts: float) -> None:
        nonlocal motions
        for name, column in spaced.items():
            columns[name].append(column[row : row + 1])
        speeds.append(np.zeros(1))
        held.append(np.array([lasts]))
        done.append(HOLD.kind)
        motions += 1

    while i < len(kinds):
        j = _run_end(planned, laws, i)
        if j == i:  # in place
            for name, column in spaced.items():
                columns[name].append(column[i + 1 : i + 2])
            speeds.append(np.zeros(1))
            held.append(planned.durations[i : i + 1] * (kinds[i] == HOLD.kind))
            done.append(executed.get(kinds[i], kinds[i]))
            motions += 1
            passed_in[i + 1] = motions, 0.0, 0.0
            i += 1
            continue
        way = np.append(0.0, np.cumsum(np.hypot(np.diff(spaced["x"][i : j + 1]), np.diff(spaced["y"][i : j + 1]))))
        limits = getattr(planned.states, SPEED)[i:j]
        ends, reached = _profile(way, limits, laws[CHANGE].acceleration)  # type: ignore[attr-defined]
        wait = 0.5 * (planned.times[j] - planned.times[i] - _lasting(ends, reached)) if planned.punctual else 0.0
        waits = wait >= LEAST
        if waits:
            add_wait(i, wait)
        for name, column in spaced.items():
            columns[name].append(np.interp(ends[1:], way, column[i : j + 1]))
        speeds.append(reached[1:])
        held.append(np.zeros(ends.size - 1))
        done += [executed.get("move", "move")] * (ends.size - 1)
        piece = np.clip(np.searchsorted(ends, way, side="right") - 1, 0, max(0, ends.size - 2))
        passed_in[i : j + 1] = np.column_stack([motions + piece, way - ends[piece], reached[piece]])
        motions += ends.size - 1
        if waits:
            add_wait(j, wait)
        i = j
    states = {name: np.concatenate(column) for name, column in columns.items()}
    states |= {SPEED: np.concatenate(speeds), CLOCK: np.cumsum(np.concatenate(held))}
    names = (*planned.model.space.names, *extras(planned.model, done))
    made = Trajectory(planned.model, States(**{name: states[name] for name in names}), tuple(done))
    return made, _passing_times(made, states[SPEED], passed_in)


def _lasting(ends: FloatArray, reached: FloatArray) -> float:
    """Return the duration, s, of a straight run that consists of ramps and cruises.

    ends     (p,)  m, distances at which a ramp or cruise begins or ends
    reached  (p,)  m/s, speed at each of these distances
    """
    total = reached[1:] + reached[:-1]
    return float(np.sum(2.0 * np.diff(ends) / total)) if ends.size > 1 else 0.0


def _passing_times(made: Trajectory, speed: FloatArray, passed_in: FloatArray) -> FloatArray:
    """Return the times (n+1,), s, at which an execution passes the planned states.

    made       the execution
    speed      m/s, at each of its states
    passed_in  (n+1, 3)  for each planned state: executed motion, distance driven in it, m, speed at its start, m/s
    """
    motion, (way, begin) = passed_in[:, 0].astype(np.int64), passed_in[:, 1:].T
    last = np.minimum(motion, max(0, len(made) - 1))
    lasts = np.append(made.durations, 0.0)[last]
    gains = np.append(np.diff(speed), 0.0)[last]
    acceleration = np.divide(gains, lasts, out=np.zeros(lasts.size), where=lasts > 0)
    there = np.sqrt(np.maximum(begin**2 + 2.0 * acceleration * way, 0.0))
    total = begin + there
    spent = np.divide(2.0 * way, total, out=np.zeros(way.size), where=(total > 0) & (way > 0))
    return np.asarray(np.maximum.accumulate(made.times[motion] + np.minimum(spent, lasts)))


def _run_end(planned: Trajectory, laws: Mapping[str, Law], begin: int) -> int:
    """Return the index after the last motion of the straight run that begins with motion ``begin``.

    A run consists of moves in one direction and changes of speed. It ends before any other motion; if ``begin`` is such
    a motion, the index is ``begin`` itself. If the plan must keep its times, a run also ends where the plan is at rest.
    """
    x, y, along, i = planned.states.x, planned.states.y, None, begin
    while i < len(planned) and SPEED in laws[planned.kinds[i]].extra:
        if "x" in laws[planned.kinds[i]].varies and (x[i], y[i]) != (x[i + 1], y[i + 1]):
            ahead = np.arctan2(y[i + 1] - y[i], x[i + 1] - x[i])
            if along is not None and abs(np.angle(np.exp(1j * (ahead - along)))) >= STRAIGHT:
                return i
            along = ahead if along is None else along
        i += 1
        if planned.punctual and getattr(planned.states, SPEED)[i] == 0.0:
            break
    return i


def _profile(way: FloatArray, limits: FloatArray, acceleration: float) -> tuple[FloatArray, FloatArray]:
    """Return the fastest profile of a run from rest to rest, as two columns.

    The first has the distances driven, m, at which ramps and cruises begin and end, from 0 on, the second the speeds
    there, m/s.

    way     (n+1,)  m    distance driven up to each planned state
    limits  (n,)    m/s  class of each planned motion; motions in place do not count
    """
    moves = np.flatnonzero(np.diff(way) > 0)
    if not moves.size:
        return np.zeros(1), np.zeros(1)
    first = np.append(True, limits[moves][1:] != limits[moves][:-1])
    top = limits[moves][first]
    ends = np.append(way[moves[first]], way[-1])
    speed = np.concatenate([[0.0], np.minimum(top[1:], top[:-1]), [0.0]])
    gain = 2.0 * acceleration * np.diff(ends)
    for i in range(top.size):
        speed[i + 1] = min(speed[i + 1], np.sqrt(speed[i] ** 2 + gain[i]))
    for i in reversed(range(top.size)):
        speed[i] = min(speed[i], np.sqrt(speed[i + 1] ** 2 + gain[i]))
    places, reached = [0.0], [0.0]
    for i, (begin, end) in enumerate(pairwise(ends.tolist())):
        squares = speed[i] ** 2, speed[i + 1] ** 2
        most = min(top[i], np.sqrt(0.5 * (squares[0] + squares[1] + gain[i])))
        faster, slower = ((most**2 - square) / (2.0 * acceleration) for square in squares)
        for at, v in ((begin + faster, most), (end - slower, most), (end, speed[i + 1])):
            if at - places[-1] > STRAIGHT * 1e-3:
                places.append(at)
                reached.append(v)
        places[-1], reached[-1] = end, speed[i + 1]
    return np.array(places), np.array(reached)


# Faults


def doubtful_speeds(law: Law, start: States, end: States) -> BoolArray:
    """Return a mask (M,) of motions for :func:`speed_faults`: all if the law has the column ``speed``, else none."""
    return np.full(start.size, SPEED in law.extra)


def speed_faults(speeds: Sequence[float], trajectory: Trajectory) -> Iterator[str]:
    """Yield a text for each fault of speeds.

    Faults are a speed at start, end or in place that is not 0; moves at no class; jumps without a change of speed;
    changes between classes that are no neighbours; and ramps that are too fast or too steep.
    """
    if not speeds or SPEED not in trajectory.states.names:
        return
    laws, column = laws_of(trajectory.model), trajectory.states.speed
    classes = np.array([0.0, *speeds])
    number = np.abs(column[:, None] - classes).argmin(axis=1)
    known = np.abs(column - classes[number]) <= SAME
    for end in (0, -1):
        if abs(column[end]) > SAME:
            yield f"{'begins' if end == 0 else 'ends'} at {column[end]:.6g} m/s, not at rest"
    of_class = ", ".join(f"{speed:g}" for speed in speeds)
    for i, kind in enumerate(trajectory.kinds):
        varies, (u, w) = laws[kind].varies, column[[i, i + 1]]
        if SPEED in varies and "x" in varies:  # a ramp of an execution
            yield from _ramp_faults(trajectory, i, classes[-1])
        elif SPEED in varies:
            both = number[i] and number[i + 1]
            if not (known[i] and known[i + 1]) or (both and abs(number[i + 1] - number[i]) > 1):
                yield f"changes from {u:.6g} to {w:.6g} m/s in motion {i}; its neighbouring speeds are {of_class}"
        elif abs(w - u) > SAME:
            yield f"jumps from {u:.6g} to {w:.6g} m/s in motion {i}, a {kind}"
        elif "x" in varies and not (known[i] and number[i]):
            yield f"drives at {u:.6g} m/s in motion {i}, which is none of its speeds {of_class}"
        elif "x" not in varies and u > SAME:
            yield f"is at {u:.6g} m/s in motion {i}, a {kind}, which is made at rest"


def _ramp_faults(trajectory: Trajectory, i: int, fastest: float) -> Iterator[str]:
    """Yield a text for each fault of the executed ramp ``i``: a speed above ``fastest`` or too large an acceleration.

    ``fastest`` is the largest speed class, m/s; accelerations are compared with the base's largest.
    """
    s = trajectory.states
    length = np.hypot(s.x[i + 1] - s.x[i], s.y[i + 1] - s.y[i])
    hardest = laws_of(trajectory.model)[CHANGE].acceleration  # type: ignore[attr-defined]
    if max(s.speed[i], s.speed[i + 1]) > fastest + SAME:
        yield f"drives faster than {fastest:g} m/s in motion {i}"
    if abs(s.speed[i + 1] ** 2 - s.speed[i] ** 2) > 2.0 * hardest * length * (1 + SAME) + SAME:
        yield f"speeds up or brakes harder than {hardest:g} m/s² in motion {i}"


def neighbouring(count: int, turns: int = 0) -> IntArray:
    """Return the allowed changes between ``count`` speed classes, as pairs (c, 2) of numbers, from and to.

    0 is rest; 1 to ``count`` are the classes, rising. Allowed are changes between rest and any class, and between
    classes next to each other. The next ``turns`` numbers are slower classes of turns, each next to rest only.
    """
    every = range(1, count + 1)
    pairs = [pair for i in range(1, count + turns + 1) for pair in ((0, i), (i, 0))]
    pairs += [pair for i, j in pairwise(every) for pair in ((i, j), (j, i))]
    return np.array(pairs, np.int64)


def turns_text(model: Model) -> str:
    """Return the kinds of turns among which a plan chooses, for certificates; "" for one turn rate."""
    turns = dict.fromkeys(kind for pace in model.paces for kind in pace.values())
    return f", each turn at one of {len(model.paces)} rates ({', '.join(turns)})" if turns else ""
