"""Which links of an arm always touch, found by sampling: no SRDF says so."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from hpop.models.serial_arm.chain import Chain, Part
from hpop.models.serial_arm.collision import KEPT, Pair
from hpop.models.serial_arm.scene import paired, scene_of

SAMPLES = 10_000
FEW = 100  # samples that leave most pairs in no doubt
SEED = 1


def always_touching(chain: Chain, parts: Sequence[Part], apart: frozenset[Pair]) -> frozenset[Pair]:
    """Pairs of links, not in ``apart``, that touch in each of 10,000 states drawn uniformly within the joints' limits.

    They would block the arm everywhere. Pairs that touch now and then are real collisions, and those that never did are
    looked at nonetheless: that proves nothing of other states.
    """
    from hpop.models.serial_arm.certificate import blocked_by

    scene = scene_of(chain, parts, ())
    states = np.random.default_rng(SEED).uniform(chain.low, chain.high, (SAMPLES, len(chain)))
    links: dict[str, list[int]] = {}
    for place, part in enumerate(parts):
        links.setdefault(part.link, []).append(place)

    def touch(one: str, other: str) -> bool:
        both = paired(scene, [(a, b) for a in links[one] for b in links[other]])
        for some in (states[:FEW], states):
            found = np.empty(len(some), np.int64)
            blocked_by(both, some, some, np.zeros_like(some), KEPT, KEPT, found)
            if (found < 0).any():
                return False
        return True

    pairs: list[Pair] = [(min(pair), max(pair)) for pair in combinations(links, 2)]
    return frozenset(pair for pair in pairs if pair not in apart and touch(*pair))
