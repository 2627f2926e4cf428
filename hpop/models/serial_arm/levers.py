"""How far the bodies of a chain can move at most while its joints do."""

from __future__ import annotations

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.models.serial_arm.chain import Chain


def levers(chain: Chain) -> FloatArray:
    """Metres (n,) that no body moves farther while a joint changes by one, rad or m.

    Of a joint that turns: how far a body can be from its axis, the lengths of all that follows added up; a joint that
    slides moves what follows as far as itself.
    """
    n = len(chain)
    lengths = np.zeros(n)  # of the step to each joint's frame, slides included
    for i in range(n):
        slide = max(abs(chain.low[i]), abs(chain.high[i])) if chain.sliding[i] else 0.0
        lengths[i] = np.linalg.norm(chain.origins[i][:3, 3]) + slide
    farthest = max((float(np.linalg.norm(mount.pose[:3, 3])) for mount in chain.mounts.values()), default=0.0)
    found = np.ones(n)
    for i in range(n):
        if chain.sliding[i]:
            continue
        steps = [chain.origins[i + 1][:3, 3]] if i + 1 < n else [mount.pose[:3, 3] for mount in chain.mounts.values()]
        aside = max((float(np.linalg.norm(np.cross(chain.axes[i], step))) for step in steps), default=0.0)
        if i + 1 < n:
            slide = lengths[i + 1] - float(np.linalg.norm(chain.origins[i + 1][:3, 3]))
            aside += slide + lengths[i + 2 :].sum() + farthest
        found[i] = aside
    return found
