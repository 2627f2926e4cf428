"""Rows of numbers separated by blanks, comments left out: what files of tracks are besides CSV."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from io import StringIO

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.text import shown
from hpop.world.tracks.table import MOST_ROWS, Asked


def read_numbers(text: str, asked: Asked, widths: Sequence[int], columns: str) -> FloatArray:
    """Finite numbers (N, one of ``widths``); MapError that names the columns and the line for anything else."""
    expected = f"expected rows of {' or '.join(map(str, widths))} numbers ({columns})"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a file without rows
            rows = np.loadtxt(StringIO(text), ndmin=2, max_rows=MOST_ROWS + 1)
    except (ValueError, OverflowError):
        raise asked.error(f"cannot be read: {expected}{_wrong_line(text, widths)}.") from None
    if not rows.shape[0]:
        raise asked.error(f"has no rows: {expected}.")
    if rows.shape[1] not in widths or not np.isfinite(rows).all():
        raise asked.error(f"cannot be read: {expected}{_wrong_line(text, widths)}.")
    return rows


def _wrong_line(text: str, widths: Sequence[int]) -> str:
    """The first line, in words, that is no row of finite numbers, as many as in the first."""
    width = None
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].split()
        width = width or len(words)
        if words and (len(words) not in {*widths} & {width} or not all(map(_is_finite, words))):
            return f"; line {number} is {shown(line)}"
    return ""


def _is_finite(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
