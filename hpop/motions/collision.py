"""Which states and motions are free of collisions: how planners and verification ask a model's geometry."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.registry import completed
from hpop.motions.states import States

if TYPE_CHECKING:
    from hpop.motions.batch import Motions
    from hpop.motions.laws import Model
    from hpop.world import World


class Collision(Protocol):
    """A robot among what blocks it in a world: obstacles, keep-out zones, people who stand, the border of the map.

    These may be left out, and have defaults (:func:`collision_of`):

    clearance        method of states (N,): distance (N,), m, of the whole robot from what blocks it; None
    least_clearance  method of motions (M,) of laws that are not coupled and a distance: the least clearance (M,), m,
                     along each, at most that distance; None where samples of ``clearance`` stand for it
    is_uncompiled    whether the first question takes longer, for kernels that are not compiled yet; False
    posture_matters  whether what is free depends on more than x, y and yaw, in the plane; False
    differs          in the plane, method of the collision in a world before, positions (P,) and a distance, m: whether
                     within it the robot may be free otherwise than before (P,); all may
    """

    def states_free(self, states: States) -> BoolArray:
        """Whether the robot is free in each state (N,)."""

    def motions_free(self, motions: Motions) -> BoolArray:
        """Whether the robot is free all along each motion (M,), ends included."""

    def why_blocked(self, state: States) -> str:
        """What blocks one state (1,) and what helps, in words without the last full stop; empty when it is free."""


class WholeCollision(Collision, Protocol):
    """The same with what may be left out."""

    @property
    def clearance(self) -> Callable[[States], FloatArray] | None: ...

    @property
    def least_clearance(self) -> Callable[[Motions, float], FloatArray] | None: ...

    @property
    def is_uncompiled(self) -> bool: ...

    @property
    def posture_matters(self) -> bool: ...


COLLISION_DEFAULTS: dict[str, Any] = {
    "clearance": None,
    "least_clearance": None,
    "is_uncompiled": False,
    "posture_matters": False,
    "differs": lambda collision, before, x, y, within: np.ones(x.shape, dtype=np.bool_),
}
"""What a collision has of the contract without saying so."""


@checked_arguments
def collision_of(model: Model, world: World) -> WholeCollision:
    """Return the collision of a model with the whole contract."""
    return cast(WholeCollision, completed(model.collision(world), COLLISION_DEFAULTS))


@checked_arguments
def free_along(collision: Collision, motions: Motions) -> BoolArray:
    """Whether the robot is free all along each motion (M,); one that holds is where it is free."""
    return collision.states_free(motions.start) if motions.stands else collision.motions_free(motions)


class PlaneCollision(Collision, Protocol):
    """The same of a robot that moves in the plane, where whole regions are known to be free at every yaw."""

    @property
    def yaw_matters(self) -> bool:
        """Whether a position that is not :meth:`clear` can still be free at some yaw."""

    @property
    def posture_matters(self) -> bool: ...

    def clear(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Whether each position (P,) is free at every yaw, and so is every turn there."""

    def differs(self, before: PlaneCollision, x: FloatArray, y: FloatArray, within: float) -> BoolArray:
        """Mark positions (P,) within a distance, m, of which the robot may be free otherwise than in a world before."""


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
