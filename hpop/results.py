"""The folder that `hpop plan` writes and `hpop show` reads: a front, and its pictures."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile, mkdtemp
from typing import TYPE_CHECKING

from hpop.errors import OutputError

if TYPE_CHECKING:
    from hpop.front import Front
    from hpop.problem import Problem

SAVED = "front.json"
LEAST_ROOM = 2**20  # bytes: a disk that is full takes empty files
PICTURES = ("map.png", "front.png", "trace.png", "where.png")


@contextmanager
def output_errors(what: str, way_out: str) -> Iterator[None]:
    """Errors of reading or writing a front, as one message."""
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


def save(front: Front, out: Path) -> None:
    """Write the front, elsewhere if need be; pictures of an earlier one would contradict it."""
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


def draw(problem: Problem, front: Front, out: Path, *, map_alone: bool = False) -> list[str]:
    """Names of the pictures drawn; they come last, and whatever goes wrong with them, the front is saved."""
    try:
        from hpop.view import save_pictures

        return [path.name for path in save_pictures(problem, front, out, map_alone=map_alone)]
    except Exception as error:
        raise OutputError(f"the front is saved in {out / SAVED}, but the pictures are not: {error!r}") from error
