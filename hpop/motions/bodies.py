"""Moving bodies as criteria see them over a batch of motions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column
from hpop.base.math import norm
from hpop.motions.laws import is_curve
from hpop.motions.states import Pose

if TYPE_CHECKING:
    from hpop.motions.batch import Motions


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Body:
    """A moving body as a criterion sees it over a batch of motions.

    start, end  poses at both ends of each motion
    length      (M,)  m    path length
    turned      (M,)  rad  absolute rotation, about whatever axis
    rotation    (M,)  rad  signed rotation about the vertical, counter-clockwise positive
    turns       columns (M,)  rad  signed rotations of the turns that end in each motion, 0 for none: the motion itself,
                      or maximal stretches of a curve in which the heading changes with one sign
    stays       whether no motion of the batch moves the body from its place
    steady      whether no motion of the batch turns it
    upright     whether no motion of the batch turns it about any axis but the vertical
    """

    start: Pose
    end: Pose
    length: Column
    turned: Column
    rotation: Column
    turns: tuple[Column, ...]
    stays: bool = False
    steady: bool = False
    upright: bool = False

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: from {self.start!r} to {self.end!r}>"


def standing(name: str, motions: Motions) -> Body:
    """What a body does while the robot holds, whatever the model: nothing."""
    nothing = 0.0 * motions.duration
    start, end = (motions.model.pose(name, states) for states in (motions.start, motions.end))
    return Body(start, end, nothing, nothing, nothing, (nothing,), stays=True, steady=True, upright=True)


@checked_arguments
def integrated(name: str, motions: Motions) -> Body:
    """What a body does by the model's twists, integrated along each motion: right for any model, exact for few.

    A model that knows closed forms gives those (:meth:`hpop.motions.Model.body`).
    """
    m = motions
    rotation = m.integrate(lambda s: s.twist(name).rotation[2])
    return Body(
        start=m.model.pose(name, m.start),
        end=m.model.pose(name, m.end),
        length=m.integrate(lambda s: norm(s.twist(name).velocity)),
        turned=m.integrate(lambda s: norm(s.twist(name).rotation)),
        rotation=rotation,
        turns=m.turns or m.law.bends(m.start, m.end) if is_curve(m.law) else (rotation,),
    )
