"""Parts of a design: conditions (stimuli), which are rows of a front that differ most, and the files of a design.

The files are design.json, which never changes, and people.json with the participants who left.
"""

from __future__ import annotations

import string
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, StringConstraints

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, IntArray
from hpop.base.options import one_of, real, whole
from hpop.base.text import counted, printable
from hpop.errors import StudyError
from hpop.frontier.choosing import farthest, scaled
from hpop.motions.bodies import check_body
from hpop.problems.front import Front
from hpop.problems.named_rows import NamedRow, named_rows
from hpop.study.documents import StrictObject, read
from hpop.study.factors import SETTINGS, Level, Levels, crossed
from hpop.study.participants import ID, MOST, MOST_STIMULI, Departure
from hpop.study.protocol import WATCHED
from hpop.trajectories.trajectory import Trajectory

VIEW = "view"
"""Name that stands for the still view from the start, in place of a row of the front."""
LIVE = "live"
"""Name that stands for a live session, which the participant drives, in place of a row of the front."""
KINDS = ("ride", "video")
ROBOT = "robot"
"""Kind of a trajectory that a real robot drives, shown by the researcher's own equipment."""
OWN_KINDS = (VIEW, LIVE)
"""Conditions that are no trajectories."""
ENDINGS = {"ride": "html", "video": "mp4", VIEW: "html"}
ALIKE = 0.1
"""Share by which durations of stimuli may differ without a note."""


class Baseline(NamedTuple):
    """Trajectory that is shown besides rows of the front, such as that of a common planner.

    name        description for the researcher
    trajectory  to ride along
    costs       by criterion, such as ``problem.evaluate(trajectory)``
    """

    name: str
    trajectory: Trajectory
    costs: Mapping[str, float]


@dataclass(frozen=True)
class Condition:
    """Stimulus of a study, which participants know only by a letter.

    id        "A", "B", ...: assigned at random, so that it does not reveal the row
    row       row of the front; None for the still view (what the camera sees at the start), a live session, a baseline
    name      name by which the row was chosen, such as "knee", "" for a number; name of a baseline; else the kind
    kind      "ride", "video", "robot" for a real robot, "view" for the still view, or "live" for a live session, which
              the participant drives
    costs     by criterion; empty for the still view and a live session
    duration  s, of the executed motion; for the still view and a live session the mean of the others
    factors   level by factor, such as {"latency": 0.5}; {} if the study has no factors
    """

    id: str
    row: int | None
    name: str
    kind: str
    costs: Mapping[str, float]
    duration: float
    factors: Mapping[str, Level] = field(default_factory=dict)

    @property
    def stimulus(self) -> str:
        """Return the path of the stimulus file, relative to the folder of the study; "" for a live one."""
        return f"stimuli/{self.id}.{ENDINGS[self.kind]}" if self.kind in ENDINGS else ""

    def to_dict(self) -> dict[str, Any]:
        """Return the condition as a dict for JSON, without factors if it has none."""
        return {name: value for name, value in asdict(self).items() if name != "factors" or value}

    def __str__(self) -> str:
        levels = ", ".join(f"{name} {level or 'none'}" for name, level in self.factors.items())
        return f"{self._row_text()}, {levels}" if levels else self._row_text()

    def _row_text(self) -> str:
        """Return the row, or another name of the stimulus, as text."""
        if self.row is None:
            known = {VIEW: "the still view", LIVE: "the live session"}
            return known.get(self.kind, f"{printable(self.name)} (baseline)")
        return f"{printable(self.name)} (row {self.row})" if self.name else f"row {self.row}"


def lettered_conditions(
    front: Front,
    rows: Sequence[int | str | NamedRow],
    kind: str,
    rng: np.random.Generator,
    baselines: Sequence[Baseline] = (),
    factors: Mapping[str, Sequence[Level]] | None = None,
) -> tuple[Condition, ...]:
    """Assign random letters to rows, baselines, the still view and a live session; return them in the order of letters.

    rows       rows by number or name; VIEW adds the still view, LIVE a live session
    kind       "ride" or "video", for all stimuli except the still view and the live session
    baselines  further trajectories
    factors    levels by factor; each combination is shown with each row and each baseline
    """
    found = [_named_row(front, row) for row in rows if row not in OWN_KINDS]
    others = [str(row) for row in rows if row in OWN_KINDS]
    combinations = crossed(factors or {})
    count = (len(found) + len(baselines)) * len(combinations) + len(others)
    if len(set(others)) < len(others):
        twice = "still view" if others.count(VIEW) > 1 else "live session"
        raise StudyError(f"the {twice} is named more than once: show it once")
    if not found or not 2 <= count <= MOST_STIMULI:
        raise StudyError(
            f"a study shows 2 to {MOST_STIMULI} stimuli, at least one of them a row of the front, got {count}"
        )
    _check_different(found)
    lasts = [row.point.trajectory.execution().duration for row in found]
    letters = iter(rng.permutation(list(string.ascii_uppercase[:count])).tolist())
    shown_rows: list[tuple[int | None, str, dict[str, float]]] = [
        (row.number, row.name, dict(row.point.costs)) for row in found
    ]
    for beside in baselines:
        lasts.append(beside.trajectory.execution().duration)
        shown_rows.append((None, beside.name, dict(beside.costs)))
    made = [
        Condition(next(letters), number, name, _kind(levels, kind), costs, lasts[i], levels)
        for i, (number, name, costs) in enumerate(shown_rows)
        for levels in combinations
    ]
    for name in others:
        made.append(Condition(next(letters), None, name, name, {}, float(np.mean(lasts))))
    return tuple(sorted(made, key=lambda condition: condition.id))


def _kind(levels: Levels, kind: str) -> str:
    """Return the kind of a condition: by its level of the factor "setting", if it has one."""
    return SETTINGS.get(str(levels.get("setting")), kind)


def _named_row(front: Front, row: int | str | NamedRow) -> NamedRow:
    """Return a row of the front under the name that the caller gave it."""
    (found,) = named_rows(front, [row.number if isinstance(row, NamedRow) else row])
    return NamedRow(found.point, row.name if isinstance(row, NamedRow) else found.name)


def _check_different(rows: Sequence[NamedRow]) -> None:
    """Raise StudyError if two rows are one row of the front under different names."""
    first: dict[int, NamedRow] = {}
    for row in rows:
        if row.number in first:
            same = first[row.number]
            raise StudyError(
                f"{same} and {row} are the same trajectory of the front; replace one of them by another row"
            )
        first[row.number] = row


def unlike(conditions: Sequence[Condition]) -> str:
    """Return a note if the longest stimulus lasts more than 10 % longer than the shortest, else ""."""
    first, *_, last = sorted(conditions, key=lambda condition: condition.duration)
    if last.duration <= (1 + ALIKE) * first.duration:
        return ""
    return (
        f"stimuli last {first.duration:.1f} s ({first}) to {last.duration:.1f} s ({last}): longer exposure alone makes "
        "people sicker"
    )


DIFFERENCES = ("costs", "paths")
PLACES = 101
"""Number of equally spaced positions at which paths are compared."""
MOMENTS = 2001
"""Number of samples of a trajectory from which the length of its path is measured."""
ROUNDING = 1e-9


@checked_arguments
def pick(
    front: Front,
    count: int,
    *,
    always: Sequence[int | str] = ("knee",),
    by: str = "costs",
    share: float | None = None,
) -> tuple[NamedRow, ...]:
    """Return rows of a front that differ most from each other, beginning with the rows in ``always``.

    Method: farthest-point selection (Gonzalez 1985).

    Parameters
    ----------
    count : number of rows, at most 26
    always : rows to include: numbers, "knee", or "least NAME"
    by : "costs", each scaled by its range over the front; or "paths", the mean distance in m between executed camera
        positions at equal shares of the path, by which paths of equal cost differ
    share : the longest returned row lasts at most 1 + ``share`` times the shortest, as executed; other rows are
        skipped, because longer exposure alone makes people sicker. None allows any durations, and the design notes
        how they differ

    Raises StudyError if there are too few rows, or too few of similar duration to those of ``always``.

    Cost: for "paths" and ``share`` every trajectory of the front is executed, some 3 ms each.
    """
    count = whole("count", count, 1, MOST_STIMULI, error=StudyError)
    one_of("by", by, DIFFERENCES, error=StudyError)
    known = named_rows(front, always)
    if len(known) > count:
        raise StudyError(
            f"count is {count}, but always names {len(known)} rows: {', '.join(map(str, known))}; raise count, or name "
            "fewer rows"
        )
    runs = [trajectory.execution() for trajectory in front.trajectories] if by == "paths" or share is not None else []
    first = [row.number for row in known]
    fitting = np.arange(len(front)) if share is None else _alike(runs, first, share)
    if fitting.size < count:
        alike = (
            "; take a smaller count"
            if share is None
            else f" of similar duration, within a share of {share:g}; allow a larger share"
        )
        raise StudyError(f"count is {count}, but the front has {counted(fitting.size, 'row')}{alike}")
    points = scaled(front.costs) if by == "costs" else np.array([_path_positions(run) for run in runs])

    def distances(place: int) -> FloatArray:
        apart = points[fitting] - points[fitting[place]]
        far = np.linalg.norm(apart, axis=-1)
        return np.asarray(far if far.ndim == 1 else far.mean(axis=1), dtype=np.float64)

    places = np.searchsorted(fitting, first).tolist()
    chosen = fitting[farthest(distances, fitting.size, count, always=places)].tolist()
    return (*known, *named_rows(front, chosen[len(known) :]))


def _alike(runs: Sequence[Trajectory], first: Sequence[int], share: float) -> IntArray:
    """Return the largest set of rows with similar executed durations that includes the rows ``first``.

    The longest duration in the set is at most 1 + ``share`` times the shortest. Raises StudyError if the durations of
    ``first`` themselves differ by more.
    """
    more = 1 + real("share", share, 0, 1, "a share of the duration", error=StudyError) + ROUNDING
    lasts = np.array([run.duration for run in runs])
    shortest, longest = (lasts[first].min(), lasts[first].max()) if first else (lasts.max(), 0.0)
    if longest > more * shortest:
        raise StudyError(
            f"rows {', '.join(map(str, first))} last {shortest:.1f} to {longest:.1f} s when executed, which differ by "
            f"more than the share {share:g}; choose other rows, or a share of {longest / shortest - 1:.2g}"
        )
    begins = np.sort(lasts[(lasts <= shortest) & (longest <= more * lasts)])
    sizes = np.searchsorted(np.sort(lasts), more * begins, "right") - np.searchsorted(np.sort(lasts), begins)
    begin = begins[np.argmax(sizes)]
    return np.flatnonzero((begin <= lasts) & (lasts <= more * begin))


def _path_positions(run: Trajectory) -> FloatArray:
    """Return camera positions (PLACES, 3), m, at equal shares of the path; all equal if the camera only turns."""
    check_body(run.model, "camera")
    times = np.linspace(0.0, run.duration, MOMENTS)
    pose = run.model.pose("camera", run.at(times))
    places = np.stack([np.broadcast_to(column, times.shape) for column in (pose.x, pose.y, pose.z)], axis=1)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    at = np.linspace(0.0, length[-1], PLACES)
    return np.stack([np.interp(at, length, column) for column in places.T], axis=1)


FILE, PEOPLE, FRONT, SCHEDULE = "design.json", "people.json", "front.json", "schedule.csv"
MOST_BYTES = 8 * 1024**2

Letter = Annotated[str, StringConstraints(pattern="^[A-Z]$")]
Id = Annotated[str, StringConstraints(pattern=f"^{ID.pattern}$")]
Digest = Annotated[str, StringConstraints(pattern="^[0-9a-f]{64}$")]
Short = Annotated[str, StringConstraints(max_length=200)]


class FrontPart(StrictObject):
    """JSON form of the study's front: its file and SHA-256."""

    file: Literal["front.json"]
    sha256: Digest


class ConditionPart(StrictObject):
    """JSON form of :class:`hpop.study.Condition`."""

    id: Letter
    row: Annotated[int, Field(ge=0)] | None
    name: Short
    kind: Literal["ride", "video", "view", "live", "robot"]
    costs: Annotated[dict[Short, float], Field(max_length=100)]
    duration: Annotated[float, Field(gt=0)]
    factors: Annotated[dict[Short, Short | float | None], Field(default_factory=dict, max_length=10)]


class ParticipantPart(StrictObject):
    """JSON form of :class:`hpop.study.Participant`."""

    id: Id
    order: Annotated[list[Letter], Field(min_length=2, max_length=MOST_STIMULI)]
    strata: Annotated[dict[Short, Short], Field(max_length=10)]


class ProtocolPart(StrictObject):
    """JSON form of :class:`hpop.study.Protocol`."""

    rest_s: float
    stop_rule: str
    watched: float = WATCHED
    tasks: dict[str, dict[str, float]] = Field(default_factory=dict)


class DesignFile(StrictObject):
    """Schema of design.json."""

    schema_: Annotated[Literal["hpop-study"], Field(alias="schema")]
    version: Literal[1]
    front: FrontPart
    seed: Annotated[int, Field(ge=0)]
    order: Literal["permutations", "williams", "latin", "random"]
    language: Short
    conditions: Annotated[list[ConditionPart], Field(min_length=2, max_length=MOST_STIMULI)]
    participants: Annotated[list[ParticipantPart], Field(min_length=1, max_length=MOST)]
    protocol: ProtocolPart
    consent: str
    forms: Annotated[list[dict[str, Any]], Field(min_length=1, max_length=50)]


class DeparturePart(StrictObject):
    """JSON form of :class:`hpop.study.Departure`."""

    participant: Id
    successor: Id
    withdrawn: bool


class PeopleFile(StrictObject):
    """Schema of people.json."""

    schema_: Annotated[Literal["hpop-study-people"], Field(alias="schema")]
    version: Literal[1]
    left: Annotated[list[DeparturePart], Field(max_length=MOST)]


def departures(path: Path) -> tuple[Departure, ...]:
    """Read the participants who left a study from people.json; () if there is no such file."""
    if not path.exists():
        return ()
    stored = read(path, PeopleFile, "the list of participants who left", MOST_BYTES)
    return tuple(Departure(one.participant, one.successor, one.withdrawn) for one in stored.left)
