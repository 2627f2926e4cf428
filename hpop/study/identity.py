"""What a front is known by, wherever it is saved: a hash of its costs, its question and what was planned."""

from __future__ import annotations

import json
from hashlib import sha256

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.problems.front import Front


@checked_arguments
def front_digest(front: Front) -> str:
    """SHA-256 of a front: its criteria, costs and trajectories, and the problem without the places of its files.

    The same before and after the front is saved, loaded and moved; another where a cost, a state or the map differs.
    """
    criteria = list(zip(front.names, front.units, front.quanta.tolist(), strict=True))
    digest = sha256(json.dumps([criteria, front.question], sort_keys=True).encode())
    digest.update(front.integers.astype("<i8").tobytes())
    for trajectory in front.trajectories:
        states = trajectory.states
        digest.update(json.dumps([list(trajectory.kinds), list(states.names)]).encode())
        for name in states.names:
            digest.update(np.asarray(getattr(states, name), dtype="<f8").tobytes())
    return digest.hexdigest()
