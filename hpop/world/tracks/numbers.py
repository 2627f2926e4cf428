"""Rows of numbers separated by blanks, comments left out: what files of tracks are besides CSV."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from io import StringIO

import numpy as np

from hpop.arrays import FloatArray
from hpop.text import shown
from hpop.world.tracks.table import MOST_ROWS, Asked


def read_numbers(text: str, asked: Asked, widths: Sequence[int], columns: str) -> FloatArray:
    """Finite numbers (N, one of ``widths``); MapError that names the columns for anything else."""
    expected = f"expected rows of {' or '.join(map(str, widths))} numbers ({columns})"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a file without rows
            rows = np.loadtxt(StringIO(text), ndmin=2, max_rows=MOST_ROWS + 1)
    except (ValueError, OverflowError) as error:
        raise asked.error(f"cannot be read: {expected}; {shown(str(error), 200)}.") from None
    if rows.shape[0] and rows.shape[1] not in widths:
        raise asked.error(f"cannot be read: {expected}, got {rows.shape[1]} in a row.")
    if not rows.shape[0]:
        raise asked.error(f"has no rows: {expected}.")
    if not np.isfinite(rows).all():
        place = int(np.argmin(np.isfinite(rows).all(axis=1)))
        raise asked.error(f"has a number that is none in row {place} (counted from 0, without comments).")
    return rows
