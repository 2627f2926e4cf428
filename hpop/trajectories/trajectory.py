"""Trajectory: timed motions from start to goal, which can be sampled at any time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, IntArray, frozen
from hpop.base.math import wrap
from hpop.base.options import LEAST, MOST, real, whole
from hpop.base.registry import with_optional_members
from hpop.base.table import Table
from hpop.base.text import shown
from hpop.errors import ModelError, OptionError
from hpop.motions import HOLD, MODEL_DEFAULTS, Curve, Model, Motions, States, is_curve, laws_of, slopes
from hpop.motions.bodies import body_table
from hpop.motions.by_law import STILL, extras, motions_of, refuse_holds, refuse_impossible, with_changes
from hpop.motions.laws import CLOCK, LONGEST

if TYPE_CHECKING:
    from hpop.world import World

STRAIGHT = 1e-6  # rad: consecutive moves whose directions differ by less are one straight run
MOST_ROWS = 10**6  # most rows of a table


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """Timed sequence of n motions of a model; each motion begins in the state in which the one before it ends.

    model     the model that moves
    states    (n+1,) columns: the states in which motions begin, and the final one. First the model's state variables
              (yaw continuous, rad), then those that curves and holds need in addition
    kinds     (n,) name of the law of each motion; empty if the start is the goal
    punctual  whether its :meth:`execution` keeps to the planned times, as it must among moving people
    """

    model: Model
    states: States
    kinds: tuple[str, ...]
    punctual: bool = False

    def __post_init__(self) -> None:
        columns = {name: frozen(np.asarray(getattr(self.states, name), float)) for name in self.states.names}
        object.__setattr__(self, "states", States(**columns))
        object.__setattr__(self, "kinds", tuple(self.kinds))
        count = len(self.kinds)
        if any(column.shape != (count + 1,) for column in columns.values()):
            shapes = ", ".join(f"{name} {column.shape}" for name, column in columns.items())
            raise ModelError(f"{count} motions need {count + 1} states in every column, got the shapes {shapes}")
        if wrong := [name for name, column in columns.items() if not np.isfinite(column).all()]:
            raise ModelError(f"the states of a trajectory must be finite numbers; got others in {', '.join(wrong)}")
        laws = laws_of(with_optional_members(self.model, MODEL_DEFAULTS))
        if unknown := set(self.kinds) - set(laws):
            raise ModelError(f"kinds must be motion laws of this model, {sorted(laws)}; got {sorted(unknown)}")
        names = (*self.model.space.names, *extras(self.model, self.kinds))
        if self.states.names != names:
            raise ModelError(f"motions of these kinds need states with the columns {names}; got {self.states.names}")
        for kind, index in self._by_kind():
            start, end = self.states.take(index), self.states.take(index + 1)
            refuse_impossible(self.model, laws[kind], start, end, index)
        refuse_holds(self.model, self.kinds, self.states)

    def __len__(self) -> int:
        return len(self.kinds)

    def __repr__(self) -> str:
        counts = ", ".join(f"{number} {kind}" for kind, number in Counter(self.kinds).items())
        return f"<Trajectory: {len(self)} motions ({counts or 'start is goal'}), {self.duration:.3f} s>"

    @classmethod
    def of_checked(cls, model: Model, states: States, kinds: tuple[str, ...], punctual: bool = False) -> Trajectory:
        """Return a trajectory without checking it again; its columns must be read-only, and its motions checked."""
        made = cls.__new__(cls)
        made.__dict__.update(model=model, states=states, kinds=kinds, punctual=punctual)
        return made

    @classmethod
    def from_poses(cls, model: Model, poses: Sequence[tuple[float, float, float]]) -> Trajectory:
        """Return the trajectory through poses (x m, y m, yaw rad): turn towards the next, move there, turn to its yaw.

        >>> from hpop.base.registry import make_model
        >>> Trajectory.from_poses(make_model("differential_drive"), [(0, 0, 0), (3, 0, 0), (3, 4, np.pi)]).kinds
        ('move', 'turn', 'move', 'turn')
        """
        if model.space.names != ("x", "y", "yaw"):
            raise ModelError(
                f"poses (x m, y m, yaw rad) are no states of this model, which are {model.space}; use "
                "Trajectory.through with States, which the model connects"
            )
        try:
            through = [(float(x), float(y), float(yaw)) for x, y, yaw in poses]
        except (TypeError, ValueError):
            through = []
        if not through:
            raise ModelError(f"a trajectory needs a list of at least one pose (x m, y m, yaw rad), got {shown(poses)}")
        x, y, yaw = through[0]
        states, kinds = [(x, y, yaw)], []

        def turn_to(heading: float) -> None:
            nonlocal yaw
            change = float(wrap(heading - yaw))
            if abs(change) > STRAIGHT:
                yaw += change
                states.append((x, y, yaw))
                kinds.append("turn")

        for to_x, to_y, to_yaw in through[1:]:
            if np.hypot(to_x - x, to_y - y) > 0:
                turn_to(float(np.arctan2(to_y - y, to_x - x)))
                x, y = to_x, to_y
                states.append((x, y, yaw))
                kinds.append("move")
            turn_to(to_yaw)
        columns = np.array(states, float).T
        return cls(model, *with_changes(model, dict(zip(model.space.names, columns, strict=True)), kinds))

    @classmethod
    def through(cls, model: Model, states: States) -> Trajectory:
        """Return a trajectory through states (N,), with the motions by which the model connects each to the next.

        Raises ModelError if the model cannot connect two of them.

        >>> from hpop.base.registry import make_model
        >>> ends = States(x=np.array([0.0, 3.0]), y=np.zeros(2), yaw=np.array([0.0, np.pi]))
        >>> Trajectory.through(make_model("differential_drive"), ends).kinds
        ('move', 'turn')
        """
        space = model.space
        if not states.names == space.names or not states.size:
            raise ModelError(
                f"a trajectory needs one or more states with the columns {space} of its model, got {states!r}"
            )
        legs = model.connect(states.take(slice(None, -1)), states.take(slice(1, None)))
        for name, off in space.differences(states.take(slice(1, None)), legs[-1].end).items():
            if (np.abs(off) > STILL).any():  # NaN is free
                i = int(np.nanargmax(np.abs(off)))
                raise ModelError(
                    f"the model cannot move from state {i} to state {i + 1}: {name} would be off by {off[i]:.3g}; give "
                    "states in between, or others"
                )
        rows, kinds = [states.take(slice(0, 1))], list[str]()
        for pair in range(states.size - 1):
            for leg in legs:
                if leg.present[pair]:
                    rows.append(space.onward(rows[-1], leg.end.take(slice(pair, pair + 1))))
                    kinds.append(leg.kind)
        columns = {name: np.concatenate([getattr(row, name) for row in rows]) for name in space.names}
        return cls(model, *with_changes(model, columns, kinds))

    def with_hold(self, *, at: int, seconds: float) -> Trajectory:
        """Return the trajectory with a pause at one of its states (n+1,), counted from 0.

        The state then occurs twice, so indices of later states grow by one. Raises OptionError for an invalid state or
        time, ModelError for more than an hour of holds in all, and for a state that a curve passes at speed.

        >>> from hpop.base.registry import make_model
        >>> goes = Trajectory.from_poses(make_model("differential_drive"), [(0, 0, 0), (3, 0, 0), (3, 4, 0)])
        >>> goes.with_hold(at=1, seconds=2.5)
        <Trajectory: 5 motions (2 move, 1 hold, 2 turn), 14.594 s>
        """
        place = whole("at", at, 0, len(self), "the number of a state of the trajectory")
        lasts = real("seconds", seconds, LEAST, LONGEST, "how long the robot stands, in s,")
        kinds = (*self.kinds[:place], HOLD.kind, *self.kinds[place:])
        columns = {name: np.insert(column, place, column[place]) for name, column in self.states.__dict__.items()}
        clock = columns.setdefault(CLOCK, np.zeros(len(kinds) + 1))
        clock[place + 1 :] += lasts
        return self._changed(columns, kinds)

    def with_holds(self, at: IntArray, seconds: FloatArray, *, punctual: bool = False) -> Trajectory:
        """Return this trajectory, which must have no holds (pauses), with holds inserted at some of its states.

        at       (h,)  indices of the states, not decreasing; several holds may be at one state
        seconds  (h,)  duration of each hold, s
        punctual       whether the execution of the result keeps to its times
        """
        if not at.size:
            return Trajectory.of_checked(self.model, self.states, self.kinds, punctual)
        columns = {name: np.insert(column, at + 1, column[at]) for name, column in self.states.__dict__.items()}
        columns[CLOCK] = np.zeros(len(self) + 1 + at.size)
        columns[CLOCK][at + 1 + np.arange(at.size)] = seconds
        columns[CLOCK] = np.cumsum(columns[CLOCK])
        kinds = np.insert(np.array(self.kinds, dtype=object), at, HOLD.kind)
        return Trajectory(self.model, States(**columns), tuple(kinds.tolist()), punctual)

    def part(self, first: int, last: int) -> Trajectory:
        """Return the trajectory from one of its states (n+1,) to another, both given by index."""
        columns = {name: column[first : last + 1] for name, column in self.states.__dict__.items()}
        return self._changed(columns, self.kinds[first:last])

    def then(self, other: Trajectory) -> Trajectory:
        """Return this trajectory followed by another one, which begins in its last state; both are at rest there."""
        own, after = self.states.__dict__, other.states.__dict__
        columns = {}
        for name in {**own, **after}:
            one, two = (
                np.zeros(len(each) + 1) if name not in part else part[name]
                for each, part in ((self, own), (other, after))
            )
            columns[name] = np.concatenate([one, two[1:] + (one[-1] - two[0] if name == CLOCK else 0.0)])
        return self._changed(columns, (*self.kinds, *other.kinds))

    def without_holds(self) -> Trajectory:
        """Return the trajectory without its holds (pauses); the trajectory itself if it has none."""
        holds = np.array([kind == HOLD.kind for kind in self.kinds], dtype=bool)
        if not holds.any():
            return self
        columns, clock = self.states.__dict__, self.states.clock
        held = np.append(0.0, np.cumsum(np.diff(clock) * holds))
        kept = np.append(True, ~holds)
        columns = {name: column[kept] for name, column in (columns | {CLOCK: clock - held}).items()}
        return self._changed(columns, tuple(kind for kind in self.kinds if kind != HOLD.kind))

    def _changed(self, columns: Mapping[str, FloatArray], kinds: tuple[str, ...]) -> Trajectory:
        """Return a trajectory with other motions, taking from ``columns`` the state columns that their laws need."""
        names = (*self.model.space.names, *extras(self.model, kinds))
        return Trajectory(self.model, States(**{name: columns[name] for name in names}), kinds, self.punctual)

    @cached_property
    def durations(self) -> FloatArray:
        """Duration (n,) of each motion, s."""
        durations = np.zeros(len(self))
        for kind, index in self._by_kind():
            durations[index] = sum(phase.duration for phase in self._phases(kind, index))
        return durations

    @cached_property
    def times(self) -> FloatArray:
        """Time (n+1,) of each state, s, from 0."""
        return np.concatenate([[0.0], np.cumsum(self.durations)])

    @property
    def duration(self) -> float:
        """Time from start to goal, s."""
        return float(self.times[-1])

    def batches(self, world: World) -> Iterator[tuple[IntArray, Motions]]:
        """Yield, for each law, the indices of its motions in time order, and these motions as one batch."""
        for kind, index in self._by_kind():
            yield index, motions_of(world, self.model, kind, self.states, self.times, self.turns, index, index)

    @cached_property
    def turns(self) -> tuple[FloatArray, FloatArray]:
        """Signed angles, rad, of the turns along curves that end in each motion: two columns (n,), 0 for none.

        A turn is a maximal stretch of curves in which the heading changes with one sign. It ends with a motion if the
        next motion turns the other way or does not turn at all, or if its law says so. It also ends within a motion
        where the yaw rate changes its sign. So up to two turns can end in one motion. Cutting curves into pieces does
        not change their turns, unless the law ends a turn with each motion.
        """
        if not any(True for _ in self._curves()):
            return np.zeros(len(self)), np.zeros(len(self))
        first, second, straight = np.zeros(len(self)), np.zeros(len(self)), np.zeros(len(self), dtype=bool)
        for index, law in self._curves():
            ends = self.states.take(index), self.states.take(index + 1)
            first[index], second[index] = law.bends(*ends)
            straight[index] = law.ends_turn(*ends)
        ended: tuple[FloatArray, FloatArray] = (np.zeros(len(self)), np.zeros(len(self)))
        rotated = 0.0  # in the stretch so far
        for i in range(len(self)):
            if i and (rotated * first[i] <= 0.0 or straight[i - 1]):
                ended[int(second[i - 1] != 0.0)][i - 1] = rotated
                rotated = 0.0
            rotated += first[i]
            if second[i]:
                ended[0][i] = rotated
                rotated = second[i]
        if len(self):
            ended[int(second[-1] != 0.0)][-1] = rotated
        return ended

    def cut(self, pieces: IntArray) -> Trajectory:
        """Return the trajectory with each motion i cut into ``pieces[i]`` motions of equal duration; pieces is (n,).

        This suits moves and curves; pieces of a turn from rest to rest would last longer than the whole.
        """
        owner = np.repeat(np.arange(len(self)), pieces)
        within = np.concatenate([np.arange(count) for count in pieces]) / pieces[owner]
        times = np.append(self.times[owner] + within * self.durations[owner], self.duration)
        return Trajectory(self.model, self.at(times), tuple(self.kinds[i] for i in owner), self.punctual)

    def at(self, t: FloatArray | float) -> States:
        """Return the states at times t (N,), s; before time 0 the robot is at the start, after the end at the goal.

        Raises OptionError for invalid times.
        """
        return self._sampled(t)[0]

    def rates(self, t: FloatArray | float) -> tuple[States, States]:
        """Return first and second time derivatives of the states at times t (N,), per s and per s².

        Under the planning law a move begins and ends at cruise speed, so use an :meth:`execution` for accelerations.
        """
        _, velocity, acceleration = self._sampled(t)
        return velocity, acceleration

    def execution(self) -> Trajectory:
        """Return the robot's real motion, with speed ramps: moves in one line become one run from rest to rest.

        The same criteria evaluate it, so that executed costs can be compared with planned ones. Without turns at the
        ends or in succession, and with runs of at least v²/a, it lasts the planned time plus v/a; else it is quicker.
        Holds last as planned; a hold between two moves costs v/a more, because it stops the robot.

        A punctual trajectory, as `lattice` and `roadmap` plan it among moving people, starts no motion earlier than
        planned: the robot waits for the planned time (:mod:`hpop.models.execution`).
        """
        return self.model.execution(self)[0]

    def table(self, step: float = 0.1, *, body: str | None = "camera", executed: bool = True) -> Table:
        """Return a table of a body's motion every ``step`` seconds and at the end, for scripts and spreadsheets.

        Columns have units: ``t``; the pose of the body (``x``, ``y``, ``z``, ``yaw``, ``pitch``, ``roll``), its
        velocity (``vx``, ``vy``, ``vz``) and rotation (``wx``, ``wy``, ``wz``), in the world's frame.

        Parameters
        ----------
        body : "base", "camera" or "tool", as far as the model has them; None gives the model's states, such as joints,
            each with its rate (``pan``, ``pan_rate``); "joints" gives the joints with rate and acceleration
            (``pan_acceleration``)
        executed : the robot's real motion, from rest to rest (:meth:`execution`); else the plan

        Raises OptionError for an invalid step, one that gives over a million rows, and for an unknown body.
        """
        run = self.execution() if executed else self
        step = real("step", step, LEAST, MOST, "a time in s")
        whole = int(run.duration / step + 1e-9)  # steps
        if whole >= MOST_ROWS:
            raise OptionError(
                f"a table may have at most {MOST_ROWS:,} rows, but a step of {step:g} s gives more in "
                f"{run.duration:g} s; choose a longer step"
            )
        times = np.round(step * np.arange(whole + 1), 9)
        if run.duration - times[-1] > 1e-6 * step:
            times = np.append(times, run.duration)
        return body_table(self.model, body, times, run.at(times), *run.rates(times))

    def describe(self) -> dict[str, Any]:
        """Return a JSON-able, exact description for a saved front."""
        return {
            "kinds": list(self.kinds),
            "states": {name: getattr(self.states, name).tolist() for name in self.states.names},
            **({"punctual": True} if self.punctual else {}),
        }

    @classmethod
    def from_description(cls, model: Model, description: Mapping[str, Any]) -> Trajectory:
        """Return a trajectory from its description; raise ModelError if it does not fit the model."""
        try:
            columns = {str(k): np.array(v, float) for k, v in description["states"].items()}
            kinds = tuple(str(kind) for kind in description["kinds"])
            punctual = description.get("punctual", False) is True
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise ModelError(
                f"expected the description of a trajectory, with kinds and states: {shown(error)}"
            ) from None
        return cls(model, States(**columns), kinds, punctual)

    def _by_kind(self) -> Iterator[tuple[str, IntArray]]:
        kinds = np.array(self.kinds, dtype=str)
        for kind in dict.fromkeys(self.kinds):
            yield kind, np.flatnonzero(kinds == kind)

    def _curves(self) -> Iterator[tuple[IntArray, Curve]]:
        for kind, index in self._by_kind():
            law = laws_of(self.model)[kind]
            if is_curve(law):
                yield index, law

    def _phases(self, kind: str, index: IntArray) -> Any:
        return laws_of(self.model)[kind].phases(self.states.take(index), self.states.take(index + 1))

    def _sampled(self, t: FloatArray | float) -> tuple[States, States, States]:
        try:
            moments = np.atleast_1d(np.asarray(t, float))
        except (TypeError, ValueError, OverflowError):
            moments = np.array([np.nan])
        if moments.ndim > 1 or np.isnan(moments).any():
            raise OptionError(f"expected a time in s, or times (N,), all numbers, got {shown(t)}")
        moments = np.clip(moments, 0.0, self.duration)
        names = self.states.names
        value = {name: np.full(moments.shape, getattr(self.states, name)[0]) for name in names}
        first = {name: np.zeros(moments.shape) for name in names}
        second = {name: np.zeros(moments.shape) for name in names}
        if len(self):
            motion = np.clip(np.searchsorted(self.times, moments, side="right") - 1, 0, len(self) - 1)
            for kind, index in self._by_kind():
                asked = np.flatnonzero(np.isin(motion, index))
                if asked.size:
                    self._sample_law(kind, motion[asked], moments[asked], asked, (value, first, second))
        return States(**value), States(**first), States(**second)

    def _sample_law(
        self, kind: str, motion: IntArray, t: FloatArray, place: IntArray, out: tuple[dict[str, FloatArray], ...]
    ) -> None:
        """Sample motions of one law at times t (n,); write values and derivatives to ``out`` at indices ``place``."""
        law = laws_of(self.model)[kind]
        start, end = self.states.take(motion), self.states.take(motion + 1)
        elapsed = t - self.times[motion]
        phases = law.phases(start, end)
        for last, phase in ((phase is phases[-1], phase) for phase in phases):
            within = (elapsed <= phase.duration) | last
            u = np.divide(elapsed, phase.duration, out=np.ones_like(elapsed), where=phase.duration > 0)
            share = phase.share(np.clip(u, 0.0, 1.0))
            speed, change = phase.share_rates(np.clip(u, 0.0, 1.0))
            chosen = within & ~np.isnan(elapsed)
            at = place[chosen]
            for name in self.states.names:
                if name in law.varies:
                    slope, bend = slopes(law, name, start, end, share)
                    out[0][name][at] = law.interpolate(name, start, end, share)[chosen]
                    out[1][name][at] = (slope * speed)[chosen]
                    out[2][name][at] = (bend * speed * speed + slope * change)[chosen]
                else:
                    out[0][name][at] = getattr(start, name)[chosen]
            elapsed = np.where(within, np.nan, elapsed - phase.duration)
