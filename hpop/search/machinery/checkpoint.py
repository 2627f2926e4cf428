"""Checkpoints: a file with the labels (partial paths) of a search, from which the search can resume.

Only labels are saved. Costs, heap keys and sets follow from the query and the labels, and are computed again
(:mod:`.machinery.labels`). A fingerprint of the graph, source, targets and options identifies the query. A search runs
in slices of equal work, and is saved between two slices. So a resumed search makes the same expansions in the same
order, and ends with the same front, paths and numbers of labels.

The file has MAGIC, the length of a header, the header in JSON (format, version of hpop, method, fingerprint, and name,
type and shape of each array), the arrays one after the other, and a checksum of all this. It is written to a temporary
file, which replaces the old one when it is complete and on the disk. So a killed process leaves the last complete file.

The checksum detects accidents, not forgery. Whatever a file contains, no code in it is run, no table is read beyond its
ends, and the paths of the resumed search are paths of the graph with their true costs. But missing labels could be
detected only by searching again, so after a resume from a forged file, a front may lack points. A lazy search also
takes from the file which arcs are free. Resume only from files that you trust.
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
from hpop.runtime.limits import Status
from hpop.search import machinery

if TYPE_CHECKING:
    from hpop.search.graph import Graph
    from hpop.search.machinery.slices import Clock, Search

MAGIC = b"hpop checkpoint\n"
FORMAT = 5  # to be raised when the file or the meaning of an array changes
LENGTH = 8  # bytes of the header's length
CHECKSUM = 32  # bytes
MAX_HEADER = 2**20  # bytes
TYPE = np.dtype(np.int64).str  # of all numbers
NONE = ""  # name of the method in a checkpoint that was saved before a search began
SHARE = 30  # the pause between two checkpoints is at least 30 times the time for writing one, so 3 % of the time

Arrays = dict[str, NDArray[Any]]


class CheckpointError(OutputError):
    """Error raised for a checkpoint file that cannot be read or written, or belongs to another query."""


@checked_arguments
@dataclass(frozen=True)
class Checkpoint:
    """File in which a search saves its state, to resume later; only one run at a time may use it.

    path   path of the file; if the file exists, the search resumes from it
    every  s   pause between two writes, longer if writing takes long; a search that a limit stops writes once more
    """

    path: str | os.PathLike[str]
    every: float = 30.0

    def __post_init__(self) -> None:
        if not isinstance(self.path, str | os.PathLike) or not os.fspath(self.path):
            raise OptionError(f"checkpoint must be the path of a file, got {shown(self.path)}")
        set_reals(self, "every", least=0, most=MOST, kind="the seconds between two checkpoints,")

    @classmethod
    def of(cls, spec: CheckpointSpec) -> Checkpoint:
        """Return a Checkpoint for a path, with default options; return a Checkpoint unchanged."""
        return spec if isinstance(spec, Checkpoint) else cls(spec)

    def checked_path(self) -> Path:
        """Return the path with links resolved.

        Raises CheckpointError if the path is not writable, or if its file is no checkpoint.
        """
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
    """Raise CheckpointError for a folder or a file other than a checkpoint, so that a search never overwrites it."""
    if not path.exists():
        return
    if not path.is_file():
        kind = "a folder" if path.is_dir() else "no ordinary file"
        raise CheckpointError(f"checkpoint must be the path of a file, but {path} is {kind}; give another path")
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise CheckpointError(
                f"checkpoint must be a new file or a checkpoint of hpop, but {path} is neither, so it is not "
                "overwritten; choose another file"
            )


CheckpointSpec: TypeAlias = str | os.PathLike[str] | Checkpoint


class Keeper:
    """Reader and writer of the checkpoint file of one query.

    question  fingerprint of the query, see :func:`fingerprint`
    saved     content of the file, until a search has resumed from it; None if there is no file
    due       s   time at which the next checkpoint is written
    extra     arrays that are saved beside the labels, such as the states of arcs of a lazy search
    """

    def __init__(self, checkpoint: Checkpoint, question: str) -> None:
        """Read the file if it exists; raise CheckpointError if it belongs to another query or is not writable."""
        self.question, self.every = question, checkpoint.every
        self.path = checkpoint.checked_path()
        self.begin({})
        self.due = perf_counter() + self.every
        self.saved = Saved.read(self.path) if self.path.exists() else None
        if self.saved is not None and self.saved.question != question:
            raise CheckpointError(
                f"the checkpoint {self.path} is of another problem: its graph, start, goal or options differ. "
                "Give another file, or remove this one if you no longer need its search"
            )

    @classmethod
    def of(cls, checkpoint: CheckpointSpec | None, graph: Graph, *question: Any) -> Self | None:
        """Return the keeper for a query on a graph, or None if ``checkpoint`` is None.

        ``question`` has all other arguments that identify the query, such as source and targets, see
        :func:`fingerprint`.
        """
        return None if checkpoint is None else cls(Checkpoint.of(checkpoint), fingerprint(graph, *question))

    @property
    def method(self) -> str | None:
        """Name of the method that saved the file; None if there is no file, or after a search has resumed from it."""
        return None if self.saved is None else self.saved.method

    def run(self, search: Search, method: str, clock: Clock) -> Status:
        """Run a search: resume it from the file if there is one, save it at intervals, and when a limit stops it.

        ``method`` is its name; a file that another method saved is not used.
        """
        if self.saved is not None and self.saved.method == method:
            began = clock.seconds()
            own = {name: array for name, array in self.saved.arrays.items() if name not in self.extra}
            restore(search, own, clock, self.path)
            clock.begin += clock.seconds() - began  # restoring is not charged
        self.saved = None  # a search by another method begins anew

        def snapshot() -> Saved:
            return Saved(method, self.question, {**vars(search.labels(clock)), **self.extra})

        self.snapshot = snapshot
        try:
            status = search.run(clock, self.save_if_due)
        except KeyboardInterrupt:
            self.save()
            raise
        if not status.is_final:
            self.save()
        return status

    def begin(self, extra: Arrays) -> None:
        """Set the extra arrays before a search begins; until it runs, a save writes only these."""
        self.extra = extra
        self.snapshot = lambda: Saved(NONE, self.question, self.extra)

    def update_extra(self, extra: Arrays) -> None:
        """Replace the extra arrays of a search that was stopped; the next save writes them with its partial paths."""
        self.extra = extra

    def save_if_due(self) -> None:
        """Write the checkpoint file if the interval has passed."""
        began = perf_counter()
        if began >= self.due:
            self.save()
            self.due = perf_counter() + max(self.every, SHARE * (perf_counter() - began))

    def save(self) -> None:
        """Write the checkpoint file. If that fails, warn and keep the last file, so that the search can go on.

        Nothing is written as long as the file has the state of a search that has not resumed yet.
        """
        if self.saved is not None:  # not resumed yet
            return
        try:
            if Saved.question_in(self.path) not in (None, self.question):
                warnings.warn(
                    f"the checkpoint {self.path} was overwritten by another search, so this one is not saved; give "
                    "each search its own file",
                    HpopWarning,
                    stacklevel=2,
                )
                return
            self.snapshot().write(self.path)
        except OSError as error:
            reason = error.strerror or error
            warnings.warn(
                f"cannot write the checkpoint {self.path} ({reason}); the last one is kept", HpopWarning, stacklevel=2
            )


@dataclass(frozen=True)
class Saved:
    """Content of a checkpoint file.

    method    name of the search method, or NONE if the file was saved before a search began
    question  fingerprint of the query
    arrays    int64 arrays by name
    """

    method: str
    question: str
    arrays: Arrays

    def write(self, path: Path) -> None:
        """Write the content to a file; an interrupted write leaves the old file."""
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
        """Return the fingerprint of the query stored in a file, or None if the file cannot be read."""
        try:
            with path.open("rb") as file:
                length = int.from_bytes(file.read(len(MAGIC) + LENGTH)[len(MAGIC) :], "little")
                return str(json.loads(file.read(min(length, MAX_HEADER)))["question"])
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            return None

    @classmethod
    def read(cls, path: Path) -> Saved:
        """Read a checkpoint from a file; raise CheckpointError if it is damaged or of another version of hpop."""
        try:
            with path.open("rb") as file:
                return cls._parsed(file, path)
        except OSError as error:
            if isinstance(error, CheckpointError):
                raise
            raise CheckpointError(
                f"cannot read the checkpoint {path}: {error.strerror or error}; choose another file"
            ) from None

    @classmethod
    def _parsed(cls, file: BufferedReader, path: Path) -> Saved:
        size = os.fstat(file.fileno()).st_size
        damaged = CheckpointError(f"the checkpoint {path} is truncated or damaged; remove it to begin the search anew")
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
                f"{FORMAT}. Resume with that version of hpop, or remove the file to begin anew"
            )
        try:
            tables = [_array_header(*entry) for entry in header["arrays"]]
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


def _array_header(name: Any, dtype: Any, shape: Any) -> tuple[str, np.dtype[Any], tuple[int, ...]]:
    """Return the name, type and shape of one array, from its entry in the header of a file.

    Raises ValueError or TypeError for an invalid entry.
    """
    if dtype != TYPE or not all(type(n) is int and 0 <= n < 2**40 for n in shape) or len(shape) > 2:
        raise ValueError
    return str(name), np.dtype(dtype), tuple(shape)


def fingerprint(graph: Graph, *question: Any) -> str:
    """Return a hash that identifies a query: of its graph and of all parts of ``question`` (numbers, texts, arrays)."""
    checksum = hashlib.blake2b(digest_size=CHECKSUM)
    for part in (graph.aggregates, *graph.tables, *question):
        array = isinstance(part, np.ndarray)
        checksum.update(repr((part.dtype.str, part.shape) if array else part).encode() + b"\n")
        if array:
            checksum.update(_bytes(part))
    return checksum.hexdigest()


def restore(search: Search, arrays: Arrays, clock: Clock, path: Path) -> None:
    """Put a new search into the state that was saved as arrays; raise CheckpointError if they do not fit its query."""
    try:
        search.resume(machinery.labels.Labels.of(arrays), clock)
    except machinery.labels.Unsound as error:
        raise invalid_checkpoint(path, error) from None


def invalid_checkpoint(path: Path, why: object) -> CheckpointError:
    """Return the error to raise for a file whose content does not fit the query, for the reason ``why``."""
    return CheckpointError(
        f"the checkpoint {path} does not fit this search ({why}); remove it to begin the search anew"
    )


def _bytes(array: NDArray[Any]) -> memoryview:
    """Return the bytes of an array, without a copy."""
    return np.ascontiguousarray(array).reshape(-1).view(np.uint8).data
