"""Errors that hpop raises for mistakes of users; each class has an exit code for the command line.

A message says what was expected, what was given, and what to do. "No path" and "time limit" are results, not errors:
they are a :class:`hpop.runtime.limits.Status`.
"""

from __future__ import annotations

import difflib
import sysconfig
from collections.abc import Iterable
from pathlib import Path
from traceback import extract_tb
from typing import ClassVar

from hpop.base.text import printable, shown

NOTE = "note: "
"""Prefix of a note on an exception that is printed on a line of its own."""


class HpopError(Exception):
    """Base class of all errors that hpop raises on purpose."""

    exit_code: ClassVar[int] = 1

    def __str__(self) -> str:
        """Return the message without terminal control characters, since it may quote a file."""
        return printable(self.args[0], newlines=True) if self.args else ""


class HpopWarning(RuntimeWarning):
    """Warning about a valid result that may not be what the user expects."""


class MapError(HpopError, ValueError):
    """Error in a map, mask or blueprint: it cannot be read, or its contents are invalid."""

    exit_code = 3


class ScenarioError(HpopError, ValueError):
    """Error in a scenario file; the message names the key and the line."""

    exit_code = 4


class QueryError(HpopError, ValueError):
    """Error in a start or goal: it is in an obstacle or off the map, or its yaw is not one of the lattice's."""

    exit_code = 5


class UnknownName(HpopError, LookupError):
    """Error for a name that is not registered, such as the name of a criterion, planner, model or export format."""

    exit_code = 7


class CriterionError(HpopError, ValueError):
    """Error in a criterion: an invalid declaration, or costs that are not one finite number >= 0 for each motion."""

    exit_code = 8


class UnsupportedCriterion(CriterionError):
    """Error for a criterion that a planner does not support; the message names a planner that does."""


class ModelError(HpopError, ValueError):
    """Error in the parameters of a robot model."""

    exit_code = 9


class UnsupportedModel(ModelError):
    """Error for a model that a planner or another function does not support; the message says why, or what does."""


class OptionError(HpopError, ValueError):
    """Error in an option of a planner or a search."""

    exit_code = 10


class GraphError(HpopError, ValueError):
    """Error in a graph: wrong shapes, negative costs, nodes out of range, or costs that would overflow."""

    exit_code = 11


class OutputError(HpopError, OSError):
    """Error in writing a result or reading a saved one."""

    exit_code = 12


class LimitError(HpopError):
    """Error for a limit that is exceeded while the map is read, before there is a front with a status."""

    exit_code = 13


class RosError(HpopError, ValueError):
    """Error in a ROS message that does not match its type, or in a request to a bridge to ROS."""

    exit_code = 15


class OwnCodeError(HpopError, ImportError):
    """Error in Python code of the user: it cannot be imported, registers nothing, or returns an invalid value."""

    exit_code = 14


class DriveError(HpopError, ValueError):
    """Error in the input of a drive, such as an unknown door, weights without a cost, or a time in the past."""

    exit_code = 16


class CoversRobot(DriveError):
    """Error for a closed area that covers the robot, so that no path could be planned."""


class StudyError(HpopError, ValueError):
    """Error in a study or a preference: its design, answers or questionnaire are invalid or contradict one another."""

    exit_code = 17


MOST_NAMES = 20
"""Largest number of criteria that a message lists."""
MOST_LETTERS = 100
"""Longest name for which similar names are suggested."""
OWN = "import its module first (on the command line --import FILE_OR_MODULE) or install its package."


def unknown_name(kind: str, name: str, known: Iterable[str]) -> UnknownName:
    """Return the error for an unknown name; its message suggests the nearest names, and explains plugins.

    It lists all names, unless there are many criteria.

    >>> print(unknown_name("criterion", "turn", ["turns", "length"]))  # doctest: +NORMALIZE_WHITESPACE
    unknown criterion 'turn'. Did you mean 'turns'? Known: length, turns.
    For one of your own, import its module first (on the command line --import FILE_OR_MODULE) or install its package.
    >>> print(unknown_name("criterion", "mine", [f"cost_{i}" for i in range(60)]))  # doctest: +NORMALIZE_WHITESPACE
    unknown criterion 'mine'.
    For one of your own, import its module first (on the command line --import FILE_OR_MODULE) or install its package.
    `hpop criteria` lists all 60
    """
    names = sorted(known)
    start = f"unknown {kind} {shown(name)}.{did_you_mean(name, names)}"
    if kind != "criterion" or len(names) <= MOST_NAMES:
        return UnknownName(f"{start} Known: {', '.join(names) or 'none'}. For one of your own, {OWN}")
    return UnknownName(f"{start} For one of your own, {OWN} `hpop criteria` lists all {len(names)}")


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """Return a question, with a space in front, that suggests the most similar known name; "" if none is similar.

    >>> did_you_mean("lenght", ["turns", "length"]), did_you_mean("mood", ["turns", "length"])
    (" Did you mean 'length'?", '')
    """
    near = (
        difflib.get_close_matches(name, list(known), n=1) if isinstance(name, str) and len(name) < MOST_LETTERS else []
    )
    return f" Did you mean {near[0]!r}?" if near else ""


def meant_file(path: Path) -> str:
    """Return a question, with a space in front, that suggests the file or folder that may be meant; "" if none is.

    path  of a file or folder that is not there; names beside it are compared with its name. A file is never taken for
          one of another kind, such as room.yaml for room.pgm
    """
    try:
        names = [entry.name for entry in path.absolute().parent.iterdir()]
    except OSError:
        return ""
    alike = [name for name in names if _may_be_kind(path.suffix, Path(name).suffix)]
    near = difflib.get_close_matches(path.name, alike, n=1)
    return f" Did you mean {str(path.with_name(near[0]))!r}?" if near and path.name else ""


def _may_be_kind(ending: str, other: str) -> bool:
    """Return whether two endings of files may be of one kind: similar, as .pgn and .png, or one of them missing."""
    return not ending or not other or bool(difflib.get_close_matches(ending, [other], cutoff=0.7))


def own_location(error: BaseException) -> str:
    """Return file and line of an error, in the innermost frame of the user's code; "" if there is none."""
    if isinstance(error, SyntaxError) and error.filename and Path(error.filename).is_file():
        return f"{error.filename}, line {error.lineno}" if error.lineno else error.filename
    libraries = [Path(__file__).parent, *(Path(sysconfig.get_path(key)) for key in ("stdlib", "purelib", "platlib"))]
    for frame in reversed(extract_tb(error.__traceback__)):
        file = Path(frame.filename)
        if file.is_file() and not any(file.is_relative_to(library) for library in libraries):
            return f"{file}, line {frame.lineno}"
    return ""


def own_failure(subject: str, error: BaseException) -> str:
    """Return a sentence on an error in the user's code, with its location; ``subject`` names the plugin that failed.

    >>> own_failure("criterion 'mine'", ZeroDivisionError("division by zero"))
    "criterion 'mine' failed: ZeroDivisionError: division by zero"
    """
    location = own_location(error)
    cause = ": ".join(filter(None, (type(error).__name__, str(error))))
    return f"{subject} failed{f' ({location})' if location else ''}: {cause}{_advice(error)}"


def _advice(error: BaseException) -> str:
    """Return what to write instead, for mistakes that are common in code on columns of values; "" for others."""
    if isinstance(error, ValueError) and "truth value of an array" in str(error):
        return "; its values are columns: instead of if write np.where(condition, a, b), or a number times (a > b)"
    if isinstance(error, AttributeError) and type(error.obj).__module__.startswith("hpop."):
        names = [name for name in dir(error.obj) if not name.startswith("_")]
        return f".{did_you_mean(error.name, names)} It has {', '.join(names)}"
    return ""
