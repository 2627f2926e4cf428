"""What files of tracks have in common: rows of who, when and where, in a unit of their own, which become tracks."""

from __future__ import annotations

import os
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from hpop.arrays import FloatArray, IntArray
from hpop.errors import MapError
from hpop.options import LEAST, one_of, real
from hpop.text import counted, shown
from hpop.world.files import named
from hpop.world.tracks.track import Track

UNITS = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
"""How many make a metre."""
FASTEST_CAMERA = 10_000.0
"""Pictures a second."""
MOST_ROWS = 5_000_000
"""Rows of a file."""

PathLike = str | os.PathLike[str]


@dataclass(frozen=True)
class Asked:
    """What whoever reads says of a file.

    frame_rate  pictures a second; None: as the file says
    unit        of places, "m", "cm" or "mm"; None: as the file says, else m
    """

    path: PathLike
    frame_rate: float | None = None
    unit: str | None = None

    def __post_init__(self) -> None:
        if self.frame_rate is not None:
            real("frame_rate", self.frame_rate, LEAST, FASTEST_CAMERA, "pictures a second", error=MapError)
        if self.unit is not None:
            one_of("the unit of a track", self.unit, UNITS, error=MapError)

    def error(self, fault: str) -> MapError:
        """What is wrong with the file."""
        return MapError(f"the track file {named(str(self.path))} {fault}")

    def rate(self, said: float | None) -> float:
        """Pictures a second, as the file says or whoever reads; MapError where neither or they differ."""
        if said is None and self.frame_rate is None:
            raise self.error(
                "counts frames and does not say how many there are a second; give frame_rate=, such as 25."
            )
        if said is not None and not 0 < said <= FASTEST_CAMERA:
            raise self.error(
                f"says that there are {said:g} frames a second; expected more than 0, up to {FASTEST_CAMERA:,.0f}."
            )
        if said is not None and self.frame_rate is not None and said != self.frame_rate:
            raise self.error(
                f"says {said:g} frames a second, and frame_rate {self.frame_rate:g}; leave frame_rate out."
            )
        return float(said if self.frame_rate is None else self.frame_rate)  # type: ignore[arg-type]  # one is there

    def a_metre(self, said: str | None) -> float:
        """How many units make a metre; MapError where the file says another one than whoever reads."""
        if said is not None and self.unit is not None and said != self.unit:
            raise self.error(f"says that places are in {said}, and unit {self.unit}; leave unit out.")
        return UNITS[self.unit or said or "m"]


def tracks_of(
    asked: Asked,
    ids: Sequence[Hashable],
    times: FloatArray,
    x: FloatArray,
    y: FloatArray,
    wanted: Sequence[Hashable] | None,
) -> dict[Hashable, Track]:
    """Recorded tracks by id, in the order in which ids first appear; each row is a point (N,), s and m.

    Raises MapError with the file and the id for what is no track, and for ids that are wanted and not there.
    """
    if not len(ids):
        raise asked.error("has no rows: expected one a person and time.")
    if len(ids) > MOST_ROWS:
        raise asked.error(f"has {len(ids):,} rows; expected at most {MOST_ROWS:,}.")
    first = dict[Hashable, int]()
    number = np.fromiter((first.setdefault(one, len(first)) for one in ids), dtype=np.int64, count=len(ids))
    if wanted is not None:
        if absent := [one for one in wanted if one not in first]:
            known = ", ".join(map(str, list(first)[:8])) + (", ..." if len(first) > 8 else "")
            raise asked.error(
                f"has nobody with the id {shown(absent[0])}; it has {counted(len(first), 'id')}: {known}."
            )
        doubled = [one for place, one in enumerate(wanted) if one in wanted[:place]]
        if doubled:
            raise asked.error(f"is asked for the id {shown(doubled[0])} twice; give each once.")
    order = np.argsort(number, kind="stable")
    ends: IntArray = np.searchsorted(number[order], np.arange(len(first) + 1))
    tracks = dict[Hashable, Track]()
    for one in first if wanted is None else wanted:
        rows = order[ends[first[one]] : ends[first[one] + 1]]
        try:
            tracks[one] = Track(times[rows], x[rows], y[rows], recorded=True)
        except MapError as error:
            raise asked.error(f"has a fault at the id {shown(one)}: {error}") from None
    return tracks


def identity(number: float) -> Hashable:
    """An id as people write it: a whole number where it is one."""
    return int(number) if number == int(number) else number
