"""Protocols of the collision tests of robot models, with the defaults of their optional members."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.registry import with_optional_members
from hpop.motions.model import Model
from hpop.motions.states import States

if TYPE_CHECKING:
    from hpop.goals.region import Region
    from hpop.motions.batch import Motions
    from hpop.world import World

COLLISION_DEFAULTS: dict[str, Any] = {
    "clearance": None,
    "least_clearance": None,
    "is_uncompiled": False,
    "posture_matters": False,
    "turn_part": 0.0,
    "projected": None,
    "kept": None,
    "constraint": "",
    "differs": lambda collision, before, x, y, within: np.ones(x.shape, dtype=np.bool_),
}
"""Values of a collision's optional members."""


class Collision(Protocol):
    """Collision test of a robot with obstacles, keep-out zones, standing people and the border of the map.

    A class may leave out these members; :func:`collision_of` then adds the default that ends each entry:

    clearance        method: takes states (N,), returns the distance (N,), m, from the robot to the nearest of these
                     things; default None
    least_clearance  method: takes motions (M,) of an uncoupled law and a distance, m; returns the smallest clearance
                     (M,), m, along each motion, at most that distance; default None, ``clearance`` is then sampled
    is_uncompiled    True if the first call must compile kernels; default False
    posture_matters  for robots in the plane: True if collisions depend on states other than x, y and yaw; default False
    turn_part        angle, rad. If a turn in place is cut at multiples of this angle, the turn is free exactly where
                     all its pieces are; default 0, if there is no such angle
    projected        method: takes states (N,), returns states moved so that they fulfil a constraint of the robot, as
                     far as possible; default None, no constraint
    kept             region (:class:`hpop.goals.Region`) in which a body stays in all states; default None
    constraint       what motions must keep besides being free, and how this is checked, for certificates; default ""
    differs          for robots in the plane, method: takes the collision test in an earlier world, positions (P,) and a
                     distance, m; returns a mask (P,): where collisions within it may have changed; default all True
    """

    def states_free(self, states: States) -> BoolArray:
        """Return whether the robot is free in each state (N,)."""

    def motions_free(self, motions: Motions) -> BoolArray:
        """Return whether the robot is free all along each motion (M,), ends included."""

    def why_blocked(self, state: States) -> str:
        """Return a text, without final full stop: what blocks one state (1,) and a remedy; "" if the state is free."""


class WholeCollision(Collision, Protocol):
    """Collision test in which all optional members of :class:`Collision` are present."""

    @property
    def clearance(self) -> Callable[[States], FloatArray] | None: ...

    @property
    def least_clearance(self) -> Callable[[Motions, float], FloatArray] | None: ...

    @property
    def is_uncompiled(self) -> bool: ...

    @property
    def projected(self) -> Callable[[States], States] | None: ...

    @property
    def kept(self) -> Region | None: ...

    @property
    def constraint(self) -> str: ...

    @property
    def posture_matters(self) -> bool: ...


@checked_arguments
def collision_of(model: Model, world: World) -> WholeCollision:
    """Return the collision test of a model in a world; optional members that it lacks get their defaults."""
    return cast(WholeCollision, with_optional_members(model.collision(world), COLLISION_DEFAULTS))


@checked_arguments
def free_along(collision: Collision, motions: Motions) -> BoolArray:
    """Return whether the robot is free all along each motion (M,); a hold, which does not move, is one state."""
    return collision.states_free(motions.start) if motions.stands else collision.motions_free(motions)


class PlaneCollision(Collision, Protocol):
    """Collision test of a robot in the plane, which can also test a position for all yaws at once."""

    @property
    def yaw_matters(self) -> bool:
        """True if a position that is not :meth:`clear` can still be free at some yaw."""

    @property
    def posture_matters(self) -> bool: ...

    @property
    def turn_part(self) -> float: ...

    def clear(self, x: FloatArray, y: FloatArray, beyond: float = 0.0) -> BoolArray:
        """Return a mask (P,): True where the robot collides at no yaw, and so in no turn in place.

        With ``beyond``, m, True also means this for all positions within that distance, and for all moves between them.
        """

    def differs(self, before: PlaneCollision, x: FloatArray, y: FloatArray, within: float) -> BoolArray:
        """Return a mask (P,) of the positions near which collisions may have changed since an earlier world.

        before  collision test in the earlier world
        x, y    m, positions (P,)
        within  m, distance from each position within which changes count
        """


class Separations(NamedTuple):
    """Distances between pairs of bodies that are close to each other, with gradients with respect to the states.

    owner     (R,)    index of the state in which each of the R pairs is close
    distance  (R,)    m, between the two bodies
    gradient  (R, n)  derivatives of the distance by the n columns of the model's state space, m per unit
    """

    owner: IntArray
    distance: FloatArray
    gradient: FloatArray


class JointCollision(Collision, Protocol):
    """Collision test of a robot with joints, such as an arm: it also returns distances and their gradients."""

    def separations(self, states: States, within: float) -> Separations:
        """Return the distance and its gradient for each pair of bodies closer than ``within`` m, in states (N,)."""
