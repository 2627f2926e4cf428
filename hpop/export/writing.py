"""Writing of trajectories for other programs: one trajectory to a file, or rows of a front in several formats."""

from __future__ import annotations

import os
import shutil
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from hpop.base.arguments import checked_arguments
from hpop.base.files import replacing
from hpop.base.registry import formats as registered
from hpop.base.text import shown
from hpop.errors import OptionError, OutputError, OwnCodeError, UnknownName
from hpop.export.base import PROGRAM, Content, Exported, Format, Frames, Jerk, default_rate
from hpop.frontier import strict_json
from hpop.problems.front import Front
from hpop.problems.named_rows import NamedRow, named_rows, stop_visits
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

ABOUT = ".about.json"
MARK = "metadata.yaml"  # file that every bag has; an existing folder without it is not replaced


@checked_arguments
def write(
    trajectory: Trajectory,
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    problem: Problem | None = None,
    rate: float | None = None,
    body: str = "camera",
    planned: bool = False,
    jerk: Jerk | None = None,
    frames: Frames | None = None,
) -> Path:
    """Write a trajectory to a file, completely or not at all, replacing an existing file, and return its path.

    The format ``bag`` writes a folder; it replaces an existing folder only if that is a bag.

    Parameters
    ----------
    path : its ending selects the format: ``cam.tum``, ``cam.unity.csv`` (``hpop formats`` lists them)
    format : name of a format, instead of the ending
    problem : problem with the world, for formats that contain it
    rate : poses or rows per second; by default 20, and 100 for joints
    body : "camera", "base" or "tool", if the robot has it, or "joints" for the values of its joints
    planned : write the planned motion; else the executed one, from rest to rest
    jerk : largest jerk of all joints of an arm, rad/s³ or m/s³, or of each by name; the executed motion is retimed
    frames : names of frames, for formats that name them

    Raises OptionError for an unknown ending and for a trajectory that the format cannot express, UnknownName for an
    unknown format, OutputError if the file cannot be written or an extra is missing.
    """
    target = _checked(path)
    if not isinstance(trajectory, Trajectory):
        raise OptionError(f"expected a trajectory, such as front.knee().trajectory, got {shown(trajectory)}")
    chosen = format_of(target) if format is None else named_format(format)
    rate = default_rate(body) if rate is None else rate
    given = Exported(trajectory, rate, body, planned, frames or Frames(), jerk, problem=problem)
    _put(target, _content(chosen, given))
    return target


@checked_arguments
def save(
    problem: Problem | None,
    front: Front,
    folder: str | os.PathLike[str],
    *,
    rows: Sequence[int | str] = ("knee",),
    formats: Sequence[str] = ("csv",),
    rate: float | None = None,
    body: str = "camera",
    planned: bool = False,
    jerk: Jerk | None = None,
    frames: Frames | None = None,
) -> list[Path]:
    """Write rows of a front in several formats to a folder, and return the paths of the files.

    Files are named ``knee_70.tum``, ``row_3.unity.csv``. For each row ``knee_70.about.json`` has the costs, the front's
    certificate, the visits of a tour's stops, and the axes of each file. Files are written atomically and replace
    existing ones. If one format is unknown or cannot be written, the others still are, and then its error is raised.

    Parameters
    ----------
    problem : problem of the front, with the world; None if no format contains the world
    rows : numbers, or names such as "knee" and "least turns" (:func:`hpop.problems.named_rows.named_rows`)
    formats : names of formats (``hpop formats`` lists them)

    The other parameters are those of :func:`write`. Raises the errors of :func:`write`, and OptionError or UnknownName
    for a missing row.
    """
    target = _checked(folder)
    if isinstance(formats, str) or not isinstance(formats, Sequence):
        raise OptionError(f"formats must be a list of names, such as ['tum', 'glb'], got {shown(formats)}")
    chosen: list[Format] = []
    written: list[Path] = []
    failed: dict[str, Exception] = {}
    for name in dict.fromkeys(formats):
        try:
            each = named_format(name)
            if each.world and problem is None:
                raise OptionError(f"the format {name} needs the world: give the problem of the front, got None")
        except (UnknownName, OptionError) as error:
            failed[name] = error
        else:
            chosen.append(each)
    rate = default_rate(body) if rate is None else rate
    for row in named_rows(front, rows):
        asked = Exported(row.point.trajectory, rate, body, planned, frames or Frames(), jerk, problem=problem)
        given = _with_row(asked, front, row)
        own: list[tuple[Path, Format]] = []
        for each in chosen:
            path = target / f"{row.stem}{each.suffix}"
            try:
                content = _content(each, given)
                with _output_errors(target):
                    target.mkdir(parents=True, exist_ok=True)
                _put(path, content)
            except Exception as error:  # a format of the user may raise anything
                failed.setdefault(each.name, error)
            else:
                own.append((path, each))
        if own:
            about = target / f"{row.stem}{ABOUT}"
            _put(about, _about(front, given, own))
            written += [*(path for path, _ in own), about]
    if failed:
        first, *others = failed.values()
        for other in others:
            first.add_note(str(other))
        missing = f"not written: {', '.join(failed)}"
        if written:
            names = ", ".join(path.name for path in written)
            first.add_note(f"other formats are written to {target}: {names}; {missing}")
        elif others:
            first.add_note(missing)
        raise first
    return written


def named_format(name: str) -> Format:
    """Return the export format with a name; raise UnknownName if there is none."""
    return cast(Format, registered[name])


def format_of(path: Path) -> Format:
    """Return the export format for a file name: the one whose ending matches, the longest if several do."""
    known = {each.suffix: each for each in map(named_format, registered)}
    fitting = [suffix for suffix in known if path.name.lower().endswith(suffix)]
    if not fitting:
        endings = ", ".join(f"{suffix} ({each.name})" for suffix, each in known.items())
        raise OptionError(
            f"expected a file name with the ending of a format, got {shown(path.name)}; give one of {endings}, or "
            "format="
        )
    return known[max(fitting, key=len)]


def _with_row(asked: Exported, front: Front, row: NamedRow) -> Exported:
    """Return what is exported, with everything that formats may write about its row of a front."""
    names, units = (*front.names, *front.reported_names), (*front.units, *front.reported_units)
    return replace(
        asked,
        row=row.number,
        name=row.name,
        costs={**row.point.costs, **row.point.reported},
        units=dict(zip(names, units, strict=True)),
        claim=f"{front.status}; {front.certificate}",
        visits=tuple(stop_visits(front, row.number, executed=not asked.planned, passed=asked.passed)),
    )


def _content(chosen: Format, given: Exported) -> Content:
    """Run a format on a trajectory and return the content; OwnCodeError unless it is bytes or files of a folder."""
    try:
        made: Any = chosen(given)
    except ImportError as error:  # a package is missing; the error says how to install it
        raise OutputError(f"{error}") from None
    files = made.values() if isinstance(made, Mapping) else [made]
    if not all(isinstance(file, bytes) for file in files):
        raise OwnCodeError(
            f"format {chosen.name!r} must return bytes, or a mapping from file names to bytes; got {shown(made)}"
        )
    return cast(Content, made)


def _about(front: Front, given: Exported, files: Sequence[tuple[Path, Format]]) -> bytes:
    """Return the content of ``ROW.about.json``, which describes the files written for a row."""
    told: dict[str, Any] = {
        "schema": "hpop-export",
        "version": 1,
        "program": PROGRAM,
        "row": given.row,
        "rows": len(front),
        "name": given.name,
        "costs": dict(given.costs),
        "units": dict(given.units),
        "status": front.status,
        "certificate": front.certificate,
        "robot": given.trajectory.model.name,
        "body": given.body,
        "planned": given.planned,
        "rate": float(given.rate),
        "duration": given.run.duration,
        "poses": given.times.size,
        **({} if given.jerk is None else {"jerk": dict(given.jerk) if isinstance(given.jerk, Mapping) else given.jerk}),
        "visits": given.told_visits,
        "frames": vars(given.frames),
        "files": [{"file": path.name, "format": each.name, "axes": each.axes} for path, each in files],
    }
    return "".join([*strict_json.pieces(told), "\n"]).encode()


def _checked(path: Any) -> Path:
    """Return a path to write to; raise OptionError if the value is not a path."""
    if not isinstance(path, str | os.PathLike) or not os.fspath(path) or not isinstance(os.fspath(path), str):
        raise OptionError(f"expected a path to write to, such as 'out/knee.tum', got {shown(path)}")
    return Path(path)


@contextmanager
def _output_errors(path: Path) -> Iterator[None]:
    """Turn an error of writing a file into one OutputError message."""
    try:
        yield
    except OutputError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a zero byte in a name
        said = getattr(error, "strerror", None) or error
        raise OutputError(f"cannot write {shown(str(path), 400)}: {said}; choose another path") from None


def _put(path: Path, content: Content) -> None:
    """Write a file, or a folder of files, completely or not at all."""
    with _output_errors(path):
        if isinstance(content, bytes):
            with replacing(path) as file:
                file.write(content)
        else:
            _put_folder(path, content)


def _put_folder(path: Path, files: Mapping[str, bytes]) -> None:
    """Write a folder of files; an existing folder is replaced only if it is a bag."""
    if os.path.lexists(path) and not (path / MARK).is_file():
        raise OutputError(f"{shown(str(path), 400)} exists and is not a bag; remove it, or choose another name")
    half = path.with_name(f".{path.name}.{uuid.uuid4().hex}.tmp")
    old = half.with_suffix(".old")
    try:
        half.mkdir()
        for name, content in files.items():
            with (half / name).open("xb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
        if path.exists():
            path.rename(old)
        half.rename(path)
    finally:
        if old.exists() and not path.exists():
            old.rename(path)
        for rest in (half, old):
            with suppress(FileNotFoundError):
                shutil.rmtree(rest)
