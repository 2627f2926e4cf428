"""Tracks of the ETH data set (Pellegrini et al., ICCV 2009), ``obsmat.txt``.

Rows of eight numbers separated by blanks: frame, id, x, z, y and the velocity in the same order; metres, y being the
second axis of the ground. People were annotated 2.5 times a second, so that the video's frame rate follows from the
step between annotated frames where it is not given.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np

from hpop.base.arrays import distinct
from hpop.world.tracks.numbers import read_numbers
from hpop.world.tracks.table import Asked, Tracks, identity, tracks_of

ANNOTATED = 2.5
"""Annotations a second."""
COLUMNS = 8


def is_obsmat(text: str) -> bool:
    """Whether a file begins with a row of eight numbers."""
    first = text.lstrip().partition("\n")[0].split()
    return len(first) == COLUMNS and not first[0].startswith("#") and "," not in first[0]


def tracks(text: str, asked: Asked, wanted: Sequence[Hashable] | None = None) -> Tracks:
    """Return tracks by id; MapError for what is no such file."""
    rows = read_numbers(text, asked, (COLUMNS,), "frame id x z y vx vz vy")
    steps = np.diff(distinct(rows[:, 0]))
    rate = asked.frame_rate if asked.frame_rate is not None or not steps.size else ANNOTATED * float(steps.min())
    times = rows[:, 0] / asked.rate(rate)
    a_metre = asked.a_metre(None)
    ids = [identity(one) for one in rows[:, 1].tolist()]
    return tracks_of(asked, ids, times, rows[:, 2] / a_metre, rows[:, 4] / a_metre, wanted)
