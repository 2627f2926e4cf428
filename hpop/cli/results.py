"""Folder that `hpop plan` writes and other commands read: a front, its problem, its pictures and its page."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile, mkdtemp
from typing import TYPE_CHECKING, Any, cast

import hpop
from hpop.base.text import argument
from hpop.errors import OutputError, UnknownName, meant_file

if TYPE_CHECKING:
    from hpop.preference import Preference
    from hpop.problems.front import Front
    from hpop.problems.problem import Problem

try:
    import fcntl
except ImportError:  # no such locks on this system
    fcntl = None  # type: ignore[assignment]


SAVED = "front.json"
LEAST_ROOM = 2**20  # bytes to test, since a full disk still takes empty files
MOST_NAMED = 3  # folders in a message
PAGE = "front.html"
RIDE = "ride.html"
PICTURES = (
    "map.png",
    "front.png",
    "trace.png",
    "where.png",
    "side.png",
    "states.png",
    "felt.png",
    "encounters.png",
    PAGE,
    RIDE,
)


@contextmanager
def output_errors(what: str, way_out: str) -> Iterator[None]:
    """Turn an error of reading or writing a file into an OutputError: ``what``, the reason, and the advice ``way_out``.

    For a file of a front with invalid content, its own message is kept instead.
    """
    try:
        yield
    except hpop.frontier.FrontFileError as error:
        raise OutputError(str(error)) from None
    except OSError as error:
        raise OutputError(f"{what}: {error.strerror or error}; {way_out}") from None


def check_writable(out: Path) -> None:
    """Raise OutputError if results cannot be written to a folder. Used before a search; leaves no files behind."""
    with output_errors(f"cannot write to {out}", "choose another --out"):
        there = next(folder for folder in (out, *out.absolute().parents) if folder.exists() or folder.is_symlink())
        with TemporaryFile(dir=there) as file:
            file.write(bytes(LEAST_ROOM))
    for name in (SAVED, *PICTURES):
        if (out / name).is_dir():
            raise OutputError(f"cannot write to {out / name}: it is a folder; remove it, or choose another --out")


@contextmanager
def held(out: Path) -> Iterator[None]:
    """Lock a folder while the ``with`` block runs, so that no second command overwrites its results.

    The folder is created if it is missing, and removed again if it stays empty. The system releases the lock when
    the process ends. On file systems without locks the folder is not locked. Raises OutputError if another
    process has the lock.
    """
    with output_errors(f"cannot write to {out}", "choose another --out"):
        made = [folder for folder in (out, *out.parents) if not folder.exists()]
        out.mkdir(parents=True, exist_ok=True)
    folder = _opened(out)
    try:
        yield
    finally:
        for empty in made:
            with suppress(OSError):
                empty.rmdir()
        if folder is not None:
            fcntl.flock(folder, fcntl.LOCK_UN)  # also if a worker process has a copy of it
            os.close(folder)


def _opened(out: Path) -> int | None:
    """Lock a folder and return its file descriptor; None if folders cannot be locked on this system."""
    if fcntl is None:
        return None
    folder = None
    try:
        folder = os.open(out, os.O_RDONLY)
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(cast(int, folder))
        raise OutputError(
            f"another `hpop plan`{_holder(out)} is writing to {out}; choose another --out, or wait until it has ended"
        ) from None
    except OSError:  # no such locks on this file system, or no right to read the folder
        if folder is not None:
            os.close(folder)
        return None
    return folder


def _holder(out: Path) -> str:
    """Return the process that has locked a folder, such as " (process 123)"; "" if the system does not tell."""
    inode = f":{out.stat().st_ino}"
    with suppress(OSError):
        for _, kind, _, _, process, file, *_ in map(str.split, Path("/proc/locks").read_text().splitlines()):
            if kind == "FLOCK" and file.endswith(inode):
                return f" (process {process})"
    return ""


def save(front: Front, out: Path) -> None:
    """Write a front to a folder, and remove the pictures and pages of earlier fronts.

    If this fails, the front is saved in a new temporary folder, and an OutputError names it.
    """
    try:
        with output_errors(f"cannot write to {out}", "choose another --out"):
            out.mkdir(parents=True, exist_ok=True)
            front.save(out / SAVED)
            for name in PICTURES:
                (out / name).unlink(missing_ok=True)
    except OutputError as error:
        rescue = Path(mkdtemp(prefix="hpop-"))
        try:
            front.save(rescue / SAVED)
        except (OSError, ValueError):
            rescue.rmdir()
            raise error from None
        raise OutputError(f"{error}; the front is saved in {rescue / SAVED}") from None


def save_page(problem: Problem, front: Front, saved: Path, preference: Preference | None = None) -> Path:
    """Write the explorer page (front.html) into the folder of a saved front; return its path."""
    return hpop.view.save_explorer(problem, front, saved.with_name(PAGE), saved=saved, preference=preference)


def page_payload(saved: Path) -> dict[str, Any]:
    """Return the data that the explorer page shows for a saved front."""
    front = hpop.Front.load(saved)
    return hpop.view.explorer.payload(hpop.Problem.from_description(front.problem or {}), front, saved=str(saved))


def draw(
    problem: Problem,
    front: Front,
    out: Path,
    *,
    map_alone: bool = False,
    max_memory: int | None = None,
    preference: Preference | None = None,
) -> list[str]:
    """Draw only the map, or all pictures and the page; return the names of the files.

    If drawing fails, an OutputError says that the front itself is saved.
    """
    drawn: list[Path] | None = None
    try:
        options: dict[str, Any] = {"map_alone": map_alone, "max_memory": max_memory, "preference": preference}
        drawn = hpop.view.save_pictures(problem, front, out, **options)
        if not map_alone:
            drawn.append(save_page(problem, front, out / SAVED, preference))
        return [path.name for path in drawn]
    except Exception as error:
        what = "the pictures are not" if drawn is None else f"{PAGE} is not"
        raise OutputError(f"the front is saved in {out / SAVED}, but {what}: {error!r}") from error


def loaded(folder: Path) -> tuple[Path, Front]:
    """Load a saved front, given its folder or its file; return the path of the file, and the front."""
    path = folder / SAVED if os.path.isdir(folder) else folder
    if os.path.isfile(path) and hpop.scenario.new.is_scenario(path):
        raise OutputError(
            f"expected a folder that `hpop plan` wrote, but {path} is a scenario; give its folder, such as "
            f"out/{path.stem}, or plan it first: hpop plan {argument(path)} --out {argument(Path('out', path.stem))}"
        )
    if os.path.isfile(path) and path.name != SAVED and (path.parent / SAVED).is_file() and path.suffix != ".json":
        raise OutputError(f"expected a folder that `hpop plan` wrote, got a file in it, {path}; give {path.parent}")
    hint = "" if os.path.exists(folder) or not (near := meant_file(folder)) else f".{near}"
    if os.path.isdir(folder) and (inside := [str(one.parent) for one in sorted(folder.glob(f"*/{SAVED}"))]):
        hint = f", such as {', '.join(inside[:MOST_NAMED])}"
    with output_errors(f"cannot read {path}", f"give the folder that `hpop plan` wrote{hint}"):
        return path, hpop.Front.load(path)


def problem_of(path: Path, front: Front) -> Problem:
    """Rebuild the problem that is stored with a saved front.

    Raises UnknownName if a criterion of the user is not imported.
    """
    try:
        return hpop.Problem.from_description(front.problem or {})
    except UnknownName as error:
        raise UnknownName(f"{path} was planned with a criterion that is unknown here: {error}") from None
