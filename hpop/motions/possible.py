"""Which motions are those of their law: what a trajectory is checked for before anything is asked of it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from hpop.base.arrays import IntArray
from hpop.errors import ModelError
from hpop.motions.hold import CLOCK, HOLD, LONGEST, laws_of, stands
from hpop.motions.laws import Law, Model, is_coupled, is_curve, slopes
from hpop.motions.states import States

STILL = 1e-6  # m or rad: a state that a motion does not change may differ by this at its ends
LED = 1e-4  # m or rad: the end of a curve may be so far from where its law leads
AT_REST = 1e-3  # m/s or rad/s: a curve that is no faster beside a hold is at rest, up to what a solver leaves


def extras(model: Model, kinds: Iterable[str]) -> tuple[str, ...]:
    """States that the laws of some kinds need beside the model's own: in order, the clock last."""
    laws = laws_of(model)
    names = dict.fromkeys(name for kind in dict.fromkeys(kinds) for name in laws[kind].extra)
    return tuple(sorted(names, key=CLOCK.__eq__))


def refuse_impossible(model: Model, law: Law, start: States, end: States, numbers: IntArray) -> None:
    """Raise ModelError that names the worst of some motions (M,) of one law, if they are none of this law.

    A law that does not vary a state would hide a jump in it from every criterion, and the states of a curve, which fix
    its way, may not contradict each other.
    """
    for name in [name for name in model.space.names if name not in law.varies]:
        jump = np.abs(getattr(end, name) - getattr(start, name))
        if jump.max() > STILL:
            i = int(np.argmax(jump))
            raise ModelError(f"a {law.kind} does not change {name}, but motion {numbers[i]} does, by {jump[i]:.3g}")
    if stands(law):
        _refuse_no_duration(law, start, end, numbers)
    if not is_coupled(law):
        return
    strays = law.strays(start, end)
    if strays.max() > LED:
        leads = "its speeds lead" if is_curve(law) else "it leads"
        clock = ", and its clock may not run backwards" * is_curve(law)
        raise ModelError(
            f"motion {numbers[np.argmax(strays)]}, a {law.kind}, ends {strays.max():.3g} m or rad from where {leads}; "
            f"the states of a {'curve' if is_curve(law) else law.kind} must agree with each other{clock}"
        )


def _refuse_no_duration(law: Law, start: States, end: States, numbers: IntArray) -> None:
    """Raise ModelError for one who stands, unless that is for a while."""
    lasts = sum(phase.duration for phase in law.phases(start, end))
    wrong = ~((lasts >= 0.0) & (lasts <= LONGEST + STILL))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ModelError(
            f"motion {numbers[i]}, a {law.kind}, lasts {lasts[i]:.6g} s; its clock may not run backwards, and it lasts "
            f"{LONGEST:,.0f} s at most"
        )


def refuse_holds(model: Model, kinds: tuple[str, ...], states: States) -> None:
    """Raise ModelError for holds of more than an hour in all, and for one beside a curve that is not at rest there."""
    if HOLD.kind not in kinds:
        return
    held = float(np.diff(states.clock)[[kind == HOLD.kind for kind in kinds]].sum())
    if held > LONGEST + STILL:
        raise ModelError(f"a trajectory holds for {LONGEST:,.0f} s at most, this one for {held:,.6g} s in all")
    laws, size = laws_of(model), len(kinds)
    for i in (i for i, kind in enumerate(kinds) if kind == HOLD.kind):
        for beside, share in ((i - 1, 1.0), (i + 1, 0.0)):
            if not (0 <= beside < size and is_curve(law := laws[kinds[beside]])):
                continue
            start, end = states.take([beside]), states.take([beside + 1])
            lasts = float(sum(phase.duration for phase in law.phases(start, end))[0])
            names = [name for name in model.space.names if name in law.varies] if lasts > 0 else []
            for name in names:
                speed = float(np.abs(slopes(law, name, start, end, np.array([share]))[0])[0]) / lasts
                if speed > AT_REST:
                    raise ModelError(
                        f"motion {i}, a {kinds[i]}, stands, but {name} changes by {speed:.3g} a second in motion "
                        f"{beside}, a {law.kind}, where they meet: hold where the robot is at rest"
                    )
