"""The folder that `hpop plan` writes and other commands read: a front, its problem, its pictures and its page."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile, mkdtemp
from typing import TYPE_CHECKING, Any, cast

from hpop.errors import OutputError, UnknownName

# Heavy modules are imported inside functions, so that `hpop --help` and wrong usage answer at once.

if TYPE_CHECKING:
    from hpop.preference import Preference
    from hpop.problems.front import Front
    from hpop.problems.problem import Problem

try:
    import fcntl
except ImportError:  # no such locks on this system
    fcntl = None  # type: ignore[assignment]


SAVED = "front.json"
LEAST_ROOM = 2**20  # bytes: a disk that is full takes empty files
PAGE = "front.html"
RIDE = "ride.html"
PICTURES = ("map.png", "front.png", "trace.png", "where.png", "side.png", "states.png", "encounters.png", PAGE, RIDE)


@contextmanager
def output_errors(what: str, way_out: str) -> Iterator[None]:
    """Turn errors of reading or writing a front into one message."""
    from hpop.frontier import FrontFileError

    try:
        yield
    except FrontFileError as error:
        raise OutputError(str(error)) from None
    except OSError as error:
        raise OutputError(f"{what}: {error.strerror or error}; {way_out}") from None


def check_writable(out: Path) -> None:
    """Make sure that results can be written, before hours are spent on finding them; nothing is left behind."""
    with output_errors(f"cannot write to {out}", "choose another --out"):
        there = next(folder for folder in (out, *out.absolute().parents) if folder.exists() or folder.is_symlink())
        with TemporaryFile(dir=there) as file:
            file.write(bytes(LEAST_ROOM))
    for name in (SAVED, *PICTURES):
        if (out / name).is_dir():
            raise OutputError(f"cannot write to {out / name}: it is a folder; remove it, or choose another --out")


@contextmanager
def held(out: Path) -> Iterator[None]:
    """Lock the folder, created if it is missing, while a plan writes to it, so no second plan overwrites it.

    The system lets go of it when the process ends, however it ends. Where folders cannot be held they are not. Folders
    that were made and stayed empty are removed. Raises OutputError where another process holds it.
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
            fcntl.flock(folder, fcntl.LOCK_UN)  # also where a worker has a copy of it
            os.close(folder)


def _opened(out: Path) -> int | None:
    """Return a folder, open and held until it is closed; None where that cannot be."""
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
    """Return the process that holds a folder, in words; nothing where the system does not tell."""
    inode = f":{out.stat().st_ino}"
    with suppress(OSError):
        for _, kind, _, _, process, file, *_ in map(str.split, Path("/proc/locks").read_text().splitlines()):
            if kind == "FLOCK" and file.endswith(inode):
                return f" (process {process})"
    return ""


def save(front: Front, out: Path) -> None:
    """Write the front, elsewhere if need be; pictures and the page of an earlier one would contradict it."""
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
    """Write the page to choose from beside the file of a front."""
    from hpop.view import save_explorer

    return save_explorer(problem, front, saved.with_name(PAGE), saved=saved, preference=preference)


def page_payload(saved: Path) -> dict[str, Any]:
    """Return the payload of the page of a saved front."""
    from hpop.problems.front import Front
    from hpop.problems.problem import Problem
    from hpop.view.explorer.payload import payload

    front = Front.load(saved)
    return payload(Problem.from_description(front.problem or {}), front, saved=str(saved))


def draw(
    problem: Problem,
    front: Front,
    out: Path,
    *,
    map_alone: bool = False,
    max_memory: int | None = None,
    preference: Preference | None = None,
) -> list[str]:
    """Names of what is drawn, the map or all pictures and the page; whatever goes wrong with it, the front is saved."""
    drawn: list[Path] | None = None
    try:
        from hpop.view import save_pictures

        drawn = save_pictures(problem, front, out, map_alone=map_alone, max_memory=max_memory, preference=preference)
        if not map_alone:
            drawn.append(save_page(problem, front, out / SAVED, preference))
        return [path.name for path in drawn]
    except Exception as error:
        what = "the pictures are not" if drawn is None else f"{PAGE} is not"
        raise OutputError(f"the front is saved in {out / SAVED}, but {what}: {error!r}") from error


def loaded(folder: Path) -> tuple[Path, Front]:
    """Return the file of a front, and the front in it."""
    from hpop.problems.front import Front

    path = folder / SAVED if os.path.isdir(folder) else folder
    with output_errors(f"cannot read {path}", "give the folder that `hpop plan` wrote"):
        return path, Front.load(path)


def problem_of(path: Path, front: Front) -> Problem:
    """Return the problem that a saved front answers."""
    from hpop.problems.problem import Problem

    try:
        return Problem.from_description(front.problem or {})
    except UnknownName as error:
        raise UnknownName(f"{path} was planned with a criterion that is not known here: {error}") from None
