"""What a solution covers, for the kernels: see :mod:`.approximation`."""

from __future__ import annotations

import numpy as np

from hpop.runtime.compiled import kernel


@kernel
def least_covered(cost: int, eps: float, tolerance: int) -> int:
    """Find the least estimate that a cost covers: the smallest f >= 0 with f + floor(eps f) + tolerance >= cost."""
    if cost <= tolerance:
        return 0
    rounding = 2 + (cost >> 50)  # of the quotient, with room to spare
    f = max(np.int64(0), np.int64((cost - tolerance) / (1.0 + eps)) - rounding)
    while f + np.int64(f * eps) + tolerance < cost:
        f += 1
    return int(f)
