"""Grouping the motions of trajectories by their motion law, and checking that they follow it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.registry import with_optional_members
from hpop.errors import ModelError
from hpop.motions.batch import Motions
from hpop.motions.laws import CHANGE, CLOCK, HOLD, LONGEST, SPEED, Law, is_coupled, is_curve, slopes, stands
from hpop.motions.model import MODEL_DEFAULTS, Model, laws_of
from hpop.motions.states import States

if TYPE_CHECKING:
    from hpop.trajectories.trajectory import Trajectory
    from hpop.world import World

STILL = 1e-6  # m or rad: tolerance for a state that a motion does not change
LED = 1e-4  # m or rad: tolerance between the end of a curve and the end that its law computes
AT_REST = 1e-3  # m/s or rad/s: tolerance for the speed of a curve where it meets a hold


def extras(model: Model, kinds: Iterable[str]) -> tuple[str, ...]:
    """Return the extra state columns that motions of some kinds need beside the model's states, the clock last."""
    laws = laws_of(model)
    names = dict.fromkeys(name for kind in dict.fromkeys(kinds) for name in laws[kind].extra)
    return tuple(sorted(names, key=CLOCK.__eq__))


def with_changes(
    model: Model, columns: Mapping[str, FloatArray], kinds: Sequence[str]
) -> tuple[States, tuple[str, ...]]:
    """Return the states (n+1,) and kinds of motions after inserting changes of speed, if the model has several speeds.

    Moves then have the fastest speed. The robot is at rest during all other motions, at the start and at the end.
    """
    speeds = with_optional_members(model, MODEL_DEFAULTS).speed_classes
    if not speeds:
        return States(**columns), tuple(kinds)
    laws = laws_of(model)
    needed = [0.0, *(speeds[-1] if SPEED in laws[kind].extra else 0.0 for kind in kinds), 0.0]
    rows, reached, inserted = [0], [0.0], list[str]()
    for i, (before, now) in enumerate(pairwise(needed)):
        steps = [(i, CHANGE)] if before != now else []
        for row, kind in [*steps, *((i + 1, kind) for kind in kinds[i : i + 1])]:
            rows.append(row)
            reached.append(now)
            inserted.append(kind)
    states = {name: column[rows] for name, column in columns.items()} | {SPEED: np.array(reached)}
    names = (*model.space.names, *extras(model, inserted))
    return States(**{name: states[name] for name in names}), tuple(inserted)


def refuse_impossible(model: Model, law: Law, start: States, end: States, numbers: IntArray) -> None:
    """Raise ModelError if some motions (M,) do not follow their law; the message names the worst one.

    A state that the law keeps constant must not jump, since no criterion would notice the jump. The states of a curve
    determine its path and must not contradict each other. ``numbers`` (M,) are the motions' numbers for the message.
    """
    for name in [name for name in model.space.names if name not in law.varies]:
        jump = np.abs(getattr(end, name) - getattr(start, name))
        if jump.max() > STILL:
            i = int(np.argmax(jump))
            raise ModelError(
                f"a {law.kind} must not change {name}, but motion {numbers[i]}, a {law.kind}, changes it by "
                f"{jump[i]:.3g}; give both ends of the motion an equal {name}"
            )
    if stands(law):
        _refuse_no_duration(law, start, end, numbers)
    if not is_coupled(law):
        return
    strays = law.strays(start, end)
    if strays.max() > LED:
        computed = "the end that its speeds and turn rates give" if is_curve(law) else "the end that its law gives"
        clock = ", and its clock must not run backwards" if is_curve(law) else ""
        raise ModelError(
            f"motion {numbers[np.argmax(strays)]}, a {law.kind}, must end within {LED:g} m or rad of {computed}, but "
            f"its end state is {strays.max():.3g} m or rad away; correct its states{clock}"
        )


def _refuse_no_duration(law: Law, start: States, end: States, numbers: IntArray) -> None:
    """Raise ModelError for a hold of negative duration, or of more than an hour."""
    lasts = sum(phase.duration for phase in law.phases(start, end))
    wrong = ~((lasts >= 0.0) & (lasts <= LONGEST + STILL))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ModelError(
            f"motion {numbers[i]}, a {law.kind}, must last 0 to {LONGEST:,.0f} s, got {lasts[i]:.6g} s, "
            f"which is the {CLOCK} of its end minus the {CLOCK} of its start; correct these"
        )


def refuse_holds(model: Model, kinds: tuple[str, ...], states: States) -> None:
    """Raise ModelError if all holds together last more than an hour, or if a curve meets a hold while it moves."""
    if HOLD.kind not in kinds:
        return
    held = float(np.diff(states.clock)[[kind == HOLD.kind for kind in kinds]].sum())
    if held > LONGEST + STILL:
        raise ModelError(
            f"all holds of a trajectory together must last at most {LONGEST:,.0f} s, got {held:,.6g} s; shorten them"
        )
    laws, size = laws_of(model), len(kinds)
    for i in (i for i, kind in enumerate(kinds) if kind == HOLD.kind):
        for beside, share in ((i - 1, 1.0), (i + 1, 0.0)):
            if not (0 <= beside < size and is_curve(law := laws[kinds[beside]]) and CLOCK in law.extra):
                continue
            start, end = states.take([beside]), states.take([beside + 1])
            lasts = float(sum(phase.duration for phase in law.phases(start, end))[0])
            names = [name for name in model.space.names if name in law.varies] if lasts > 0 else []
            for name in names:
                speed = float(np.abs(slopes(law, name, start, end, np.array([share]))[0])[0]) / lasts
                if speed > AT_REST:
                    raise ModelError(
                        f"the robot must be at rest where a hold begins or ends, but where motion {beside}, a "
                        f"{law.kind}, meets motion {i}, a {kinds[i]}, {name} still changes by {speed:.3g} a second; "
                        "let the curve end at rest, or move the hold"
                    )


def batches(trajectories: Sequence[Trajectory], world: World) -> Iterator[tuple[IntArray, Motions]]:
    """Yield the motions of many trajectories of one model, in one batch for each motion law.

    Each batch comes with an array (M,): the index of the trajectory to which each motion belongs.
    """
    if not trajectories:
        return
    model = trajectories[0].model
    names = dict.fromkeys(name for t in trajectories for name in t.states.names)
    nothing = {len(t): np.full(len(t) + 1, np.nan) for t in trajectories}  # columns that its laws do not need
    states = States(**{n: np.concatenate([getattr(t.states, n, nothing[len(t)]) for t in trajectories]) for n in names})
    times = np.concatenate([t.times for t in trajectories])
    sizes = np.array([len(t) for t in trajectories])
    owner = np.repeat(np.arange(len(trajectories)), sizes)
    begins = np.arange(owner.size) + owner  # every trajectory has one state more than motions
    first, second = (np.concatenate([t.turns[side] for t in trajectories]) for side in (0, 1))
    kinds = np.array([kind for t in trajectories for kind in t.kinds], dtype=str)
    for kind in dict.fromkeys(kinds.tolist()):
        index = np.flatnonzero(kinds == kind)
        yield owner[index], motions_of(world, model, kind, states, times, (first, second), index, begins[index])


def motions_of(
    world: World,
    model: Model,
    kind: str,
    states: States,
    times: FloatArray,
    turns: tuple[FloatArray, FloatArray],
    index: IntArray,
    begins: IntArray,
) -> Motions:
    """Return as one batch those motions of many trajectories that follow one law.

    kind    name of the law, such as "move"
    states  states of all trajectories, one after another
    times   s, time of each of these states
    turns   rad, for each motion of all trajectories: signed rotations of the turns that end in it, in two columns
            (:attr:`Motions.turns`)
    index   (M,) numbers of the batch's motions among all motions
    begins  (M,) numbers of the states in which these motions begin
    """
    law, names = laws_of(model)[kind], (*model.space.names, *extras(model, (kind,)))
    start, end = (States(**{name: getattr(states, name)[at] for name in names}) for at in (begins, begins + 1))
    ended = (turns[0][index], turns[1][index]) if is_curve(law) else None
    return Motions(world, model, law, start, end, t0=times[begins], turns=ended)
