"""p values of several tests at once, adjusted so that a false alarm among all of them stays as rare as for one."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.options import one_of
from hpop.base.text import shown
from hpop.errors import StudyError

Correction = Literal["holm", "bonferroni", "none"]
CORRECTIONS: tuple[Correction, ...] = ("holm", "bonferroni", "none")


@checked_arguments
def adjusted(p: Any, correction: str = "holm") -> FloatArray:
    """Adjust p values (m,) for being m, in their order; a NaN stays one and counts for none.

    ``bonferroni`` multiplies each by m. ``holm`` (1979, Scandinavian Journal of Statistics 6, 65-70) multiplies the
    least by m, the next by m - 1, and so on, never falling: it rejects whatever Bonferroni does, and more.

    >>> adjusted([0.01, 0.04, 0.03]).round(3).tolist(), adjusted([0.01, 0.04, 0.03], "bonferroni").round(3).tolist()
    ([0.03, 0.06, 0.06], [0.03, 0.12, 0.09])
    """
    one_of("correction", correction, CORRECTIONS, error=StudyError)
    values = np.array(p, dtype=float)
    if values.ndim != 1:
        raise StudyError(f"p must be a list of p values (m,), got {shown(p)}")
    known = np.flatnonzero(~np.isnan(values))
    rising = known[np.argsort(values[known], kind="stable")]
    count = len(rising)
    if correction == "bonferroni":
        values[rising] *= count
    elif correction == "holm":
        values[rising] = np.maximum.accumulate(values[rising] * np.arange(count, 0, -1))
    capped: FloatArray = np.minimum(values, 1.0)
    return capped
