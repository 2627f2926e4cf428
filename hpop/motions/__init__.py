"""Motions: batches of short robot movements of one kind, on which all criteria are defined.

All motions of a batch follow one motion law: they are all straight moves, for example, or all turns in place. The edges
of a lattice, the pieces of a trajectory and the intervals of a nonlinear program are batches of motions. A column holds
one entry for each of the M motions, as a NumPy array (M,) or as CasADi symbols that behave like one. A criterion
written over motions therefore runs unchanged on graphs, on trajectories and inside nonlinear programs.
"""

from __future__ import annotations

from hpop.motions.batch import Motions
from hpop.motions.bodies import (
    Body,
    Collision,
    Instants,
    JointCollision,
    PlaneCollision,
    Rate,
    Separations,
    collision_of,
    free_along,
    integrated,
)
from hpop.motions.laws import (
    HOLD,
    Coupled,
    Curve,
    Hold,
    Law,
    LawDefaults,
    Leg,
    Phase,
    is_coupled,
    is_curve,
    onward,
    slopes,
    stands,
)
from hpop.motions.model import (
    MODEL_DEFAULTS,
    Model,
    ModelInTime,
    Wheeled,
    lacking,
    laws_of,
)
from hpop.motions.states import Pose, States, StateSpace, Twist, Vector

__all__ = [
    "HOLD",
    "MODEL_DEFAULTS",
    "Body",
    "Collision",
    "Coupled",
    "Curve",
    "Hold",
    "Instants",
    "JointCollision",
    "Law",
    "LawDefaults",
    "Leg",
    "Model",
    "ModelInTime",
    "Motions",
    "Phase",
    "PlaneCollision",
    "Pose",
    "Rate",
    "Separations",
    "StateSpace",
    "States",
    "Twist",
    "Vector",
    "Wheeled",
    "collision_of",
    "free_along",
    "integrated",
    "is_coupled",
    "is_curve",
    "lacking",
    "laws_of",
    "onward",
    "slopes",
    "stands",
]
