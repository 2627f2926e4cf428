"""Which states and motions are free of collisions: how planners and verification ask a model's geometry."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

from hpop.arguments import checked_arguments
from hpop.arrays import BoolArray, FloatArray, IntArray
from hpop.motions.states import States

if TYPE_CHECKING:
    from hpop.motions.batch import Motions


class Collision(Protocol):
    """A robot among what blocks it in a world: obstacles, keep-out zones, people who stand, the border of the map.

    It may have a method ``clearance(states)``: how far (N,), m, the whole robot is from that.
    """

    def states_free(self, states: States) -> BoolArray:
        """Whether the robot is free in each state (N,)."""

    def motions_free(self, motions: Motions) -> BoolArray:
        """Whether the robot is free all along each motion (M,), ends included."""

    def why_blocked(self, state: States) -> str:
        """What blocks one state (1,) and what helps, in words without the last full stop; empty when it is free."""


@checked_arguments
def free_along(collision: Collision, motions: Motions) -> BoolArray:
    """Whether the robot is free all along each motion (M,); one that holds is where it is free."""
    return collision.states_free(motions.start) if motions.stands else collision.motions_free(motions)


class PlaneCollision(Collision, Protocol):
    """The same of a robot that moves in the plane, where whole regions are known to be free at every yaw."""

    @property
    def yaw_matters(self) -> bool:
        """Whether a position that is not :meth:`clear` can still be free at some yaw."""

    def clear(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Whether each position (P,) is free at every yaw, and so is every turn there."""


class Separations(NamedTuple):
    """How far bodies are apart that are near each other, and how that changes with the states.

    owner     (R,)    the state, of those asked about
    distance  (R,)    m
    gradient  (R, n)  by the columns of the model's space, m a unit
    """

    owner: IntArray
    distance: FloatArray
    gradient: FloatArray


class JointCollision(Collision, Protocol):
    """The same of a robot of joints, whose distances have gradients."""

    def separations(self, states: States, within: float) -> Separations:
        """Of all pairs of bodies nearer than so many metres in states (N,)."""
