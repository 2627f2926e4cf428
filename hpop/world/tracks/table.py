"""Convert tables with a person, a time and a position per row, in given units, to tracks."""

from __future__ import annotations

import os
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.options import LEAST, one_of, real
from hpop.base.text import counted, shown, some
from hpop.errors import MapError
from hpop.world.files import named
from hpop.world.tracks.track import FASTEST, Track

UNITS = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
"""Names of units of length, each with the number of units in a metre."""
FASTEST_CAMERA = 10_000.0
"""Largest frame rate, frames per second."""
MOST_ROWS = 5_000_000
"""Largest number of rows of a file."""
EPOCHS = {1e18: 1e-9, 1e15: 1e-6, 1e12: 1e-3, 1e9: 1.0}
"""Length of the unit of times since 1970, s, by the least such time in this unit: the number that it had in 2001."""
SINCE_1970 = 1e8
"""Time, s, above which times count as times since 1970."""
LEAVES = 10.0
"""Absence, s, after which a person counts as a different person."""
MISSING = 1.0
"""Absence, s, above which a person is mentioned in a note, if it is also longer than five usual time steps."""

MOSTLY = 0.9
"""Least share of time steps that are regular in a recording by a camera, and of steps at speeds that people reach."""
MOST_NAMED = 8
"""Largest number of people that a note names."""

PathLike = str | os.PathLike[str]


@dataclass(frozen=True)
class TrackFile:
    """File of tracks, with the options for reading it.

    frame_rate  frames per second; None: as stated in the file
    unit        of positions, "m", "cm" or "mm"; None: as stated in the file, else m
    hint        text appended to each error
    """

    path: PathLike
    frame_rate: float | None = None
    unit: str | None = None
    hint: str = ""

    def __post_init__(self) -> None:
        if self.frame_rate is not None:
            real("frame_rate", self.frame_rate, LEAST, FASTEST_CAMERA, "pictures a second", error=MapError)
        if self.unit is not None:
            one_of("the unit of a track", self.unit, UNITS, error=MapError)

    def error(self, fault: str) -> MapError:
        """Return an error that names the file and its fault."""
        return MapError(f"the track file {named(str(self.path))} {fault}{self.hint}")

    def rate(self, said: float | None) -> float:
        """Return the frames per second: those stated in the file (``said``) or the option ``frame_rate``.

        Raises MapError if both are missing or they differ, or if the file's rate is impossible.
        """
        if said is None and self.frame_rate is None:
            raise self.error(
                "counts frames and does not say how many there are per second; give frame_rate=, such as 25."
            )
        if said is not None and not 0 < said <= FASTEST_CAMERA:
            raise self.error(
                f"states a frame rate of {said:g} per second; expected more than 0, up to {FASTEST_CAMERA:,.0f}."
            )
        if said is not None and self.frame_rate is not None and said != self.frame_rate:
            raise self.error(
                f"states a frame rate of {said:g} per second, but frame_rate is {self.frame_rate:g}; leave out the "
                "option frame_rate."
            )
        return float(said if self.frame_rate is None else self.frame_rate)  # type: ignore[arg-type]  # one is there

    def a_metre(self, said: str | None) -> float:
        """Return the number of units in a metre; MapError if file (``said``) and options state different units."""
        if said is not None and self.unit is not None and said != self.unit:
            raise self.error(f"says that positions are in {said}, but unit is {self.unit}; leave unit out.")
        return UNITS[self.unit or said or "m"]


class Tracks(dict[Hashable, Track]):
    """Tracks by id, in the order of the file, or in that of ``ids`` where these were given.

    notes  on all that was left out, repaired or assumed
    """

    notes: tuple[str, ...] = ()


class _Points(NamedTuple):
    """Points (N,) of all people, sorted by person and time.

    who  index of the person
    t    s
    x    m
    y    m
    """

    who: IntArray
    t: FloatArray
    x: FloatArray
    y: FloatArray

    def take(self, kept: BoolArray | IntArray) -> _Points:
        """Return the points that are marked by a mask, or have the given indices."""
        return _Points(self.who[kept], self.t[kept], self.x[kept], self.y[kept])

    @property
    def goes_on(self) -> BoolArray:
        """Return which points (N - 1,), of all but the last, are followed by another point of the same person."""
        return np.asarray(np.diff(self.who) == 0)

    @property
    def speeds(self) -> FloatArray:
        """Return the speed (N - 1,), m/s, from each point to the next; 0 between different people."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            speeds = np.hypot(np.diff(self.x), np.diff(self.y)) / np.diff(self.t)
        return np.where(self.goes_on, speeds, 0.0)


def tracks_of(
    source: TrackFile,
    ids: Sequence[Hashable],
    times: FloatArray,
    x: FloatArray,
    y: FloatArray,
    wanted: Sequence[Hashable] | None,
    *,
    second: float | None = 1.0,
    notes: Iterable[str] = (),
) -> Tracks:
    """Build recorded tracks by id from N rows, each a point of a person.

    Tracks are in the order of ``wanted``, by default that in which ids first appear.

    times   (N,)  in units of ``second`` s; None: in s, or in the unit guessed for times since 1970
    x, y    (N,)  m
    wanted  ids of the tracks to return; None for all

    Rows are sorted by time, and repeated rows count once. Single points that are too far away to be reached, and people
    with one point, are left out; but a ``wanted`` person with one point is an error. A person who jumps, or is missing
    for more than ``LEAVES`` s, continues as another person, such as "7 (2)". Between rows a person walks straight.
    Notes of the result report all this. Raises MapError, with the file and the id, for an invalid track or a missing
    id.
    """
    if not len(ids):
        raise source.error("has no rows: expected a row per person and time.")
    if len(ids) > MOST_ROWS:
        raise source.error(f"has {len(ids):,} rows; expected at most {MOST_ROWS:,}: split it.")
    first = dict[Hashable, int]()
    number = np.fromiter((first.setdefault(name, len(first)) for name in ids), dtype=np.int64, count=len(ids))
    names = list(first)
    chosen = list(range(len(names))) if wanted is None else _numbers(source, wanted, first)
    told = [*notes]
    times, since = _seconds(times, second)
    told += since
    points, mended = _sorted(_Points(number, times, x, y), names)
    points, cleared = _without_wrong_points(points, names)
    parts, split = _parts(points, names)
    told += [*mended, *cleared, *split]
    tracks, alone = Tracks(), []
    for who in chosen:
        of_one = parts[who]
        for place, rows in enumerate(of_one):
            name = names[who] if place == 0 else f"{names[who]} ({place + 1})"
            if rows.stop - rows.start < 2 and (wanted is None or len(of_one) > 1):
                alone.append(str(name))
                continue
            try:
                tracks[name] = Track(points.t[rows], points.x[rows], points.y[rows], recorded=True)
            except MapError as error:
                raise source.error(f"has a fault at the id {shown(name)}: {error}") from None
    if not tracks:
        raise source.error(
            f"has no person with rows at two times that can be joined to a track; it has {counted(len(names), 'id')}. "
            "Check that the columns of ids and times are right."
        )
    if alone:
        told.append(f"has people at one time only, who are left out: {some(alone, MOST_NAMED)}")
    tracks.notes = tuple(f"the track file {named(str(source.path))} {note}" for note in told)
    return tracks


def _numbers(source: TrackFile, wanted: Sequence[Hashable], first: Mapping[Hashable, int]) -> list[int]:
    """Return the indices of the wanted ids; MapError if an id is missing or wanted twice."""
    if absent := [name for name in wanted if name not in first]:
        known = ", ".join(map(str, list(first)[:8])) + (", ..." if len(first) > 8 else "")
        raise source.error(f"has no id {shown(absent[0])}; it has {counted(len(first), 'id')}: {known}.")
    doubled = [name for index, name in enumerate(wanted) if name in wanted[:index]]
    if doubled:
        raise source.error(f"cannot be read with ids that repeat {shown(doubled[0])}; give each id once.")
    return [first[name] for name in wanted]


def _seconds(times: FloatArray, second: float | None) -> tuple[FloatArray, list[str]]:
    """Convert times (N,) to s, and return them with notes; times since 1970 are shifted to begin at 0.

    Times are in units of ``second`` s; if that is None, in s or in the unit guessed for times since 1970.
    """
    begin = float(times.min())
    if second is None:
        second = next((unit for least, unit in EPOCHS.items() if least <= begin < 5 * least), 1.0)
    if not SINCE_1970 <= begin * second < 50 * SINCE_1970:
        return times * second, []
    moment = datetime.fromtimestamp(begin * second, UTC).isoformat(sep=" ", timespec="milliseconds")
    return (times - begin) * second, [f"counts time from 1970 on; its first, {moment}, is taken as 0 s"]


def _sorted(points: _Points, names: Sequence[Hashable]) -> tuple[_Points, list[str]]:
    """Return the points sorted by person and time, without repetitions, and notes."""
    notes = []
    given = points.take(np.argsort(points.who, kind="stable"))
    back = given.goes_on & (np.diff(given.t) < 0)
    if back.any():
        notes.append(f"has rows that are not in order of time; they are sorted: {_named(names, given.who[:-1][back])}")
    points = points.take(np.lexsort((points.t, points.who)))
    twice = points.goes_on & (np.diff(points.t) == 0) & (np.diff(points.x) == 0) & (np.diff(points.y) == 0)
    if twice.any():
        rows = counted(int(twice.sum()), "row")
        notes.append(f"repeats {rows}; each counts once: {_named(names, points.who[1:][twice])}")
    return points.take(np.append(True, ~twice)), notes


def _without_wrong_points(points: _Points, names: Sequence[Hashable]) -> tuple[_Points, list[str]]:
    """Return the points without outliers, which a person could not reach and leave fast enough, and notes on them."""
    fast = _few(points.speeds > FASTEST)
    wrong = np.concatenate([[False], fast[:-1] & fast[1:], [False]]) if fast.size else np.zeros(points.t.size, bool)
    if not wrong.any():
        return points, []
    where = some([f"{names[who]} at {t:.4g} s" for who, t in zip(points.who[wrong], points.t[wrong], strict=True)])
    return points.take(~wrong), [
        f"has single points that take more than {FASTEST:g} m/s to reach and to leave again; they are left out: {where}"
    ]


def _parts(points: _Points, names: Sequence[Hashable]) -> tuple[list[list[slice]], list[str]]:
    """Split each person's points at jumps and long absences.

    Return, for each person, the slices of ``points`` that count as different people, and notes.
    """
    steps, goes_on = np.diff(points.t), points.goes_on
    usual = float(np.median(steps[goes_on])) if goes_on.any() else np.inf
    missing = goes_on & (steps > max(MISSING, 5 * usual))
    regular = steps[goes_on & ~missing] <= 2 * usual
    watched = usual <= MISSING and regular.mean() >= MOSTLY
    fast = points.speeds > FASTEST
    jumps, leaves = _few(fast), missing & (steps > LEAVES) & watched
    notes = []
    if fast.any() and not jumps.any():
        notes.append(
            f"has people who are faster than {FASTEST:g} m/s in {counted(int(fast.sum()), 'step')} of "
            f"{int(goes_on.sum()):,}; check the unit and the frame rate: {_named(names, points.who[:-1][fast])}"
        )
    for which, said in (
        (jumps & ~leaves, f"has people who jump (faster than {FASTEST:g} m/s), and then count as other people"),
        (leaves, f"has people who are missing for more than {LEAVES:g} s, and then count as other people"),
        (
            missing & ~leaves & ~jumps,
            "has people who are missing for a while, and are assumed to walk straight meanwhile",
        ),
    ):
        if which.any():
            each = zip(points.who[:-1][which], points.t[:-1][which], steps[which], strict=True)
            notes.append(
                f"{said}: {some([f'{names[who]} after {t:.4g} s, for {step:.3g} s' for who, t, step in each])}"
            )
    ends = np.flatnonzero(~goes_on | jumps | leaves) + 1
    parts: list[list[slice]] = [[] for _ in names]
    for begin, end in zip([0, *ends.tolist()], [*ends.tolist(), points.t.size], strict=True):
        parts[int(points.who[begin])].append(slice(begin, end))
    return parts, notes


def _few(marked: BoolArray) -> BoolArray:
    """Return the marks if they are few, else no marks: many faults mean a wrong unit, which is reported elsewhere.

    Few are at most a tenth of all steps or, in a short file, at most a third of them and at most two.
    """
    most = max((1 - MOSTLY) * marked.size, min(2.0, marked.size / 3))
    return marked if marked.sum() <= most else np.zeros_like(marked)


def _named(names: Sequence[Hashable], numbers: IntArray) -> str:
    return some([str(names[number]) for number in dict.fromkeys(numbers.tolist())], MOST_NAMED)


def identity(number: float) -> Hashable:
    """Return a numerical id, as int if it is a whole number."""
    return int(number) if number == int(number) else number
