"""Motions: a batch of short movements under one law, which is all that a criterion ever sees.

The edges of a lattice, the pieces of a trajectory and the intervals of a nonlinear program are all batches of motions.
Columns have shape (M,), one entry a motion: NumPy arrays, or CasADi symbols that behave like them. A criterion written
over motions therefore runs unchanged on graphs, on trajectories and inside nonlinear programs.
"""

from __future__ import annotations

from hpop.motions.batch import Motions, lacking
from hpop.motions.bodies import Body, integrated
from hpop.motions.collision import Collision, JointCollision, PlaneCollision, Separations, collision_of, free_along
from hpop.motions.hold import HOLD, Hold, laws_of, stands
from hpop.motions.instants import Instants, Rate
from hpop.motions.laws import (
    MODEL_DEFAULTS,
    Coupled,
    Curve,
    Law,
    LawDefaults,
    Leg,
    Model,
    Phase,
    Wheeled,
    is_coupled,
    is_curve,
    onward,
    slopes,
)
from hpop.motions.space import StateSpace
from hpop.motions.states import Pose, States, Twist, Vector

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
