"""Tracks from files: which format a file has, and what it says."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Literal, get_args

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.options import one_of
from hpop.base.scalars import python_value
from hpop.base.text import shown
from hpop.errors import MapError
from hpop.world.files import read_bytes, read_text
from hpop.world.tracks import csv, jupedsim, obsmat, petrack
from hpop.world.tracks.jupedsim import is_jupedsim
from hpop.world.tracks.obsmat import is_obsmat
from hpop.world.tracks.petrack import is_petrack
from hpop.world.tracks.table import Asked, PathLike, Tracks

TrackFormat = Literal["csv", "petrack", "obsmat", "jupedsim"]
MAX_BYTES = 200_000_000
"""Largest file of tracks that is read."""


@checked_arguments
def read_tracks(
    path: PathLike,
    frame_rate: float | None = None,
    unit: str | None = None,
    format: TrackFormat | None = None,
    ids: Sequence[Hashable] | None = None,
) -> Tracks:
    """Return recorded tracks of people from a file, by their ids, in the file's order.

    Parameters
    ----------
    path : CSV (id, t or frame, x, y), a PeTrack text file (id frame x y z), an ``obsmat.txt`` of the ETH data set, or
        what JuPedSim writes (SQLite, or text of versions before 1.0)
    frame_rate : frames a second, where the file counts frames and does not say it
    unit : of places, "m", "cm" or "mm", where the file does not say it; m by default
    format : "csv", "petrack", "obsmat" or "jupedsim" (SQLite); by default as the file looks
    ids : whose tracks are read; all by default

    Times are those of the file: frame 0 is 0 s; times since 1970 begin at 0 s. :meth:`Track.later` makes another moment
    0. The result's ``notes`` say what was left out, mended or taken for granted: people at one time only, points that
    nobody can reach, gaps, rows out of order, the order of columns without a header.

    Raises MapError for a file that cannot be read, is too large, says two things, or has no tracks: two places at one
    time, numbers that are none, and speeds that tell of a wrong unit.
    """
    asked = Asked(path, frame_rate, unit)
    if ids is not None:
        several = isinstance(ids, list | tuple) or (isinstance(ids, np.ndarray) and ids.ndim == 1)
        chosen = [python_value(one) for one in ids] if several else []
        if not chosen or not all(isinstance(one, str | int | float) for one in chosen):
            raise MapError(f"ids are a list of numbers and names, such as [1, 7]; got {shown(ids)}.")
        ids = chosen
    if format is not None:
        one_of("the format of a track file", format, get_args(TrackFormat), error=MapError)
    data = read_bytes(path, "the track file", limit=MAX_BYTES)  # type: ignore[arg-type]  # checked there
    if format == "jupedsim" or (format is None and is_jupedsim(data)):
        return jupedsim.tracks(data, asked, ids)
    text = read_text(data, path, "the track file")  # type: ignore[arg-type]  # checked there
    if text.lstrip()[:1] in ("{", "["):
        raise asked.error("is JSON, which is not read; write it as CSV: a line id,t,x,y, then a row a person and time.")
    if format == "obsmat" or (format is None and is_obsmat(text)):
        return obsmat.tracks(text, asked, ids)
    if format == "petrack" or (format is None and is_petrack(text, asked)):
        return petrack.tracks(text, asked, ids)
    return csv.tracks(text, asked, ids)
