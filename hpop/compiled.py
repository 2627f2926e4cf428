"""numba, loaded without scipy.linalg: kernels come from here. Imported on first use only, it takes half a second.

Before its first kernel numba imports scipy.linalg, only to learn whether matrix products can be compiled: a quarter of
a second, for products that no kernel here takes. They can, for hpop requires SciPy, so for that moment the question is
left out; numba asks again where a product is compiled.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numba
from numba import njit

__all__ = ["njit", "numba"]


def _load_without_scipy() -> None:
    with suppress(ImportError, AttributeError):  # another version of numba may look elsewhere: then it takes longer
        linalg: Any = __import__("numba.np.linalg", fromlist=["ensure_blas"])
        asked = linalg.ensure_blas
        linalg.ensure_blas = lambda: None
        try:
            import numba.np.arraymath  # noqa: F401
        finally:
            linalg.ensure_blas = asked


_load_without_scipy()
