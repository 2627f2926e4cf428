"""Tracks from files: which format a file has, and what it says."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from importlib import import_module
from typing import Literal, cast, get_args

from hpop.errors import MapError
from hpop.options import one_of
from hpop.text import shown
from hpop.world.files import read_bytes, read_text
from hpop.world.tracks.obsmat import is_obsmat
from hpop.world.tracks.petrack import is_petrack
from hpop.world.tracks.table import Asked, PathLike
from hpop.world.tracks.track import Track

TrackFormat = Literal["csv", "petrack", "obsmat"]
MAX_BYTES = 200_000_000
"""Largest file of tracks that is read."""


def read_tracks(
    path: PathLike,
    frame_rate: float | None = None,
    unit: str | None = None,
    format: TrackFormat | None = None,
    ids: Sequence[Hashable] | None = None,
) -> dict[Hashable, Track]:
    """Recorded tracks of people from a file, by their ids, in the file's order.

    Parameters
    ----------
    path : CSV (id, t or frame, x, y), a PeTrack text file (id frame x y z), or an ``obsmat.txt`` of the ETH data set
    frame_rate : frames a second, where the file counts frames and does not say it
    unit : of places, "m", "cm" or "mm", where the file does not say it; m by default
    format : "csv", "petrack" or "obsmat"; by default as the file looks
    ids : whose tracks are read; all by default

    Times are those of the file: frame 0 is 0 s. :meth:`Track.later` makes another moment 0.

    Raises MapError for a file that cannot be read, is too large, says two things, or has no tracks: times of a person
    that are repeated or go back, one point only, numbers that are none, and speeds that tell of a wrong unit.
    """
    asked = Asked(path, frame_rate, unit)
    if ids is not None and not (
        isinstance(ids, list | tuple) and ids and all(isinstance(one, str | int | float) for one in ids)
    ):
        raise MapError(f"ids are a list of numbers and names, such as [1, 7]; got {shown(ids)}.")
    if format is not None:
        one_of("the format of a track file", format, get_args(TrackFormat), error=MapError)
    text = read_text(read_bytes(path, "the track file", limit=MAX_BYTES), path, "the track file")  # type: ignore[arg-type]  # checked there
    kind = format or ("obsmat" if is_obsmat(text) else "petrack" if is_petrack(text) else "csv")
    reader = import_module(f"hpop.world.tracks.{kind}")
    return cast(dict[Hashable, Track], reader.tracks(text, asked, ids))
