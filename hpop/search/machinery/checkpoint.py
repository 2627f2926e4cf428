"""Checkpoints: the labels of a search in a file, from which it goes on as if it had never stopped.

What follows from the question and the labels (costs, keys, sets) is made again, see :mod:`.machinery.labels`; a
fingerprint tells which question the file belongs to: the graph, its ends, the options. A search runs in slices of equal
work, and is saved between two of them; so the one that goes on makes the same expansions in the same order, and ends
with the same front, paths and counts of labels.

The file: MAGIC, the length of a header, the header in JSON (format, version of hpop, method, fingerprint, name, type
and shape of each array), the arrays one after the other, a checksum of all this. It is written beside its place,
and moved there once it is whole and on the disk: whoever is killed leaves the last whole one.

The checksum tells accidents, it is no signature. Whatever the numbers of a file are, nothing in it is run, no place
outside a table is read, and what a search has found after it went on are paths of the graph with their true costs. But
nobody can tell without searching again whether labels are missing: a file from a stranger proves nothing about what is
*not* there, and a front that comes of it may lack points. A lazy search also takes from it which arcs
are free. Go on from files that you, or whom you trust, have written.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import warnings
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hpop import __version__
from hpop.base.arguments import checked_arguments
from hpop.base.files import check_replaceable, replacing
from hpop.base.options import MOST, set_reals
from hpop.base.text import shown
from hpop.errors import HpopWarning, OptionError, OutputError
from hpop.runtime.status import Status

if TYPE_CHECKING:
    from hpop.search.graph import Graph
    from hpop.search.machinery.slices import Clock, Search

MAGIC = b"hpop checkpoint\n"
FORMAT = 5  # raise it when the file, or what a search means by one of its arrays, changes
LENGTH = 8  # bytes of the header's length
CHECKSUM = 32  # bytes
MAX_HEADER = 2**20  # bytes
TYPE = np.dtype(np.int64).str  # of all numbers
NONE = ""  # the method of no search
SHARE = 30  # the pause between two checkpoints is so many times what writing the last one took: three in a hundred

Arrays = dict[str, NDArray[Any]]


class CheckpointError(OutputError):
    """A checkpoint cannot be read or written, or belongs to another search."""


@checked_arguments
@dataclass(frozen=True)
class Checkpoint:
    """The file in which a search keeps its state; one run at a time may use it.

    path   of the file; if it is there, the search goes on from it
    every  s  between two checkpoints, or more where writing takes long; one more is written when the search is stopped
    """

    path: str | os.PathLike[str]
    every: float = 30.0

    def __post_init__(self) -> None:
        if not isinstance(self.path, str | os.PathLike) or not os.fspath(self.path):
            raise OptionError(f"checkpoint must be the path of a file, got {shown(self.path)}")
        set_reals(self, "every", least=0, most=MOST, kind="the seconds between two checkpoints,")

    @classmethod
    def of(cls, spec: CheckpointSpec) -> Checkpoint:
        """A checkpoint from a path, or itself."""
        return spec if isinstance(spec, Checkpoint) else cls(spec)

    def place(self) -> Path:
        """Where the file is, links followed; raises CheckpointError where it cannot be written, or is none of these."""
        try:
            path = Path(os.path.realpath(self.path))
            _refuse_other(path)
            check_replaceable(path)
        except CheckpointError:
            raise
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise CheckpointError(f"cannot write a checkpoint to {self.path}: {reason}; choose another file") from None
        return path


def _refuse_other(path: Path) -> None:
    """Raise CheckpointError where something is that is no checkpoint: it is not overwritten."""
    if not path.exists():
        return
    if not path.is_file():
        what = "a folder" if path.is_dir() else "no ordinary file"
        raise CheckpointError(f"the checkpoint {path} is {what}; give the path of a file")
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise CheckpointError(f"{path} is no checkpoint of hpop, so it is not overwritten; choose another file")


CheckpointSpec: TypeAlias = str | os.PathLike[str] | Checkpoint


class Keeper:
    """The checkpoint of one question: what the file holds, and when to write the next.

    beside  what is kept beside the labels of a search: what was known before that search began
    """

    def __init__(self, checkpoint: Checkpoint, question: str) -> None:
        """Read the file, if it is there; raises CheckpointError where it is not of this question, or not writable."""
        self.question, self.every = question, checkpoint.every
        self.path = checkpoint.place()
        self.begin({})
        self.due = perf_counter() + self.every
        self.saved = Saved.read(self.path) if self.path.exists() else None
        if self.saved is not None and self.saved.question != question:
            raise CheckpointError(
                f"the checkpoint {self.path} is of another problem: its graph, start, goal or options differ from what "
                "is asked. Give another file, or remove this one if its search is no longer wanted"
            )

    @classmethod
    def of(cls, checkpoint: CheckpointSpec | None, graph: Graph, *question: Any) -> Self | None:
        """The keeper for a question about a graph; None where no checkpoint is wanted."""
        return None if checkpoint is None else cls(Checkpoint.of(checkpoint), fingerprint(graph, *question))

    @property
    def method(self) -> str | None:
        """The method of the search that the file holds."""
        return None if self.saved is None else self.saved.method

    def run(self, search: Search, method: str, clock: Clock) -> Status:
        """Let a new search go on from the file, if there is one, and save it now and then, and when it is stopped."""
        if self.saved is not None and self.saved.method == method:
            began = clock.seconds()
            own = {name: array for name, array in self.saved.arrays.items() if name not in self.beside}
            restore(search, own, clock, self.path)
            clock.begin += clock.seconds() - began  # is no search
        self.saved = None  # a search by another method, which takes over, begins anew

        def made() -> Saved:
            return Saved(method, self.question, {**vars(search.labels(clock)), **self.beside})

        self.made = made
        try:
            status = search.run(clock, self.keep)
        except KeyboardInterrupt:
            self.save()
            raise
        if not status.is_final:
            self.save()
        return status

    def begin(self, beside: Arrays) -> None:
        """Before a search: what is known beside it."""
        self.beside = beside
        self.made = lambda: Saved(NONE, self.question, self.beside)

    def amend(self, beside: Arrays) -> None:
        """What is known beside a search that was stopped."""
        self.beside = beside

    def keep(self) -> None:
        """Save, if it is time."""
        began = perf_counter()
        if began >= self.due:
            self.save()
            self.due = perf_counter() + max(self.every, SHARE * (perf_counter() - began))

    def save(self) -> None:
        """Write what there is; if that fails, warn: what was saved before stays, and the search goes on."""
        if self.saved is not None:  # nothing went on from it yet
            return
        try:
            if Saved.question_in(self.path) not in (None, self.question):
                warnings.warn(
                    f"the checkpoint {self.path} has become that of another search, so this one is not kept; give each "
                    "search a file of its own",
                    HpopWarning,
                    stacklevel=2,
                )
                return
            self.made().write(self.path)
        except OSError as error:
            reason = error.strerror or error
            warnings.warn(
                f"cannot write the checkpoint {self.path} ({reason}); the last one stays", HpopWarning, stacklevel=2
            )


@dataclass(frozen=True)
class Saved:
    """What a checkpoint holds."""

    method: str
    question: str
    arrays: Arrays

    def write(self, path: Path) -> None:
        """Write a checkpoint, whole or not at all."""
        header = {
            "format": FORMAT,
            "hpop": __version__,
            "method": self.method,
            "question": self.question,
            "arrays": [[name, array.dtype.str, array.shape] for name, array in self.arrays.items()],
        }
        text = json.dumps(header).encode()
        begin = MAGIC + len(text).to_bytes(LENGTH, "little") + text
        checksum = hashlib.blake2b(digest_size=CHECKSUM)
        with replacing(path) as file:
            for piece in (memoryview(begin), *map(_bytes, self.arrays.values())):
                file.write(piece)
                checksum.update(piece)
            file.write(checksum.digest())

    @classmethod
    def question_in(cls, path: Path) -> str | None:
        """Return the question of the checkpoint in a file, None where there is none that can be read."""
        try:
            with path.open("rb") as file:
                length = int.from_bytes(file.read(len(MAGIC) + LENGTH)[len(MAGIC) :], "little")
                return str(json.loads(file.read(min(length, MAX_HEADER)))["question"])
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            return None

    @classmethod
    def read(cls, path: Path) -> Saved:
        """Read a checkpoint; raises CheckpointError where it is a damaged one, or of another version."""
        try:
            with path.open("rb") as file:
                return cls._of(file, path)
        except OSError as error:
            if isinstance(error, CheckpointError):
                raise
            raise CheckpointError(
                f"cannot read the checkpoint {path}: {error.strerror or error}; choose another file"
            ) from None

    @classmethod
    def _of(cls, file: BufferedReader, path: Path) -> Saved:
        size = os.fstat(file.fileno()).st_size
        damaged = CheckpointError(
            f"the checkpoint {path} is truncated or damaged; remove it, the search then begins anew"
        )
        begin = file.read(len(MAGIC) + LENGTH)
        length = int.from_bytes(begin[len(MAGIC) :], "little")
        if length > min(MAX_HEADER, size - len(begin)):
            raise damaged
        text = file.read(length)
        try:
            header = json.loads(text)
            version, form = header["hpop"], header["format"]
        except (ValueError, TypeError, KeyError, RecursionError):
            raise damaged from None
        if (form, version) != (FORMAT, __version__):
            raise CheckpointError(
                f"the checkpoint {path} is of hpop {version}, format {form}; this is hpop {__version__}, format "
                f"{FORMAT}. Go on with that version, or remove the file to begin anew"
            )
        try:
            tables = [_table(*entry) for entry in header["arrays"]]
            method, question = str(header["method"]), str(header["question"])
        except (ValueError, TypeError, KeyError):
            raise damaged from None
        room = size - len(begin) - length - CHECKSUM
        if sum(math.prod(shape) * dtype.itemsize for _, dtype, shape in tables) != room:
            raise damaged
        checksum = hashlib.blake2b(begin + text, digest_size=CHECKSUM)
        arrays: Arrays = {}
        for name, dtype, shape in tables:
            arrays[name] = np.empty(shape, dtype)
            file.readinto(_bytes(arrays[name]))
            checksum.update(_bytes(arrays[name]))
        if file.read() != checksum.digest():
            raise damaged
        return cls(method, question, arrays)


def _table(name: Any, dtype: Any, shape: Any) -> tuple[str, np.dtype[Any], tuple[int, ...]]:
    """Name, type and shape of an array as the header gives them; raises ValueError or TypeError for nonsense."""
    if dtype != TYPE or not all(type(n) is int and 0 <= n < 2**40 for n in shape) or len(shape) > 2:
        raise ValueError
    return str(name), np.dtype(dtype), tuple(shape)


def fingerprint(graph: Graph, *question: Any) -> str:
    """A hash of a graph and of what is asked about it: numbers, words and arrays."""
    tables = (graph.indptr, graph.heads, graph.costs)
    checksum = hashlib.blake2b(digest_size=CHECKSUM)
    for part in (graph.aggregates, *tables, *question):
        array = isinstance(part, np.ndarray)
        checksum.update(repr((part.dtype.str, part.shape) if array else part).encode() + b"\n")
        if array:
            checksum.update(_bytes(part))
    return checksum.hexdigest()


def restore(search: Search, arrays: Arrays, clock: Clock, path: Path) -> None:
    """Let a new search go on from labels; raises CheckpointError where they are not those of its question."""
    from hpop.search.machinery.labels import Labels, Unsound  # numba: on first use

    try:
        search.resume(Labels.of(arrays), clock)
    except Unsound as error:
        raise not_kept(path, error) from None


def not_kept(path: Path, why: object) -> CheckpointError:
    """What to raise where a file does not hold what a search of its question keeps."""
    return CheckpointError(
        f"the checkpoint {path} does not hold what this search keeps ({why}); remove it, the search then begins anew"
    )


def _bytes(array: NDArray[Any]) -> memoryview:
    """The bytes of an array, not copied."""
    return np.ascontiguousarray(array).reshape(-1).view(np.uint8).data
