"""What hpop raises for a user's mistake: one class an outcome, each with the exit code of the command line.

A message says what was expected, what came, and what to do. "No path" and "time ran out" are results, not
errors: they are a :class:`hpop.runtime.status.Status`.
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
"""How a note of an exception begins that stands on a line of its own: one on the map, where an end cannot be used."""


class HpopError(Exception):
    """Base of every error that hpop raises on purpose."""

    exit_code: ClassVar[int] = 1

    def __str__(self) -> str:
        """The message, harmless to a terminal: it may quote what came from a file."""
        return printable(self.args[0], newlines=True) if self.args else ""


class HpopWarning(RuntimeWarning):
    """Something that the user should know, though the answer stands."""


class MapError(HpopError, ValueError):
    """A map, mask or blueprint cannot be read, or makes no sense."""

    exit_code = 3


class ScenarioError(HpopError, ValueError):
    """A scenario file is wrong; the message names the key and the line."""

    exit_code = 4


class QueryError(HpopError, ValueError):
    """The start or the goal cannot be used: in an obstacle, off the map, off the headings."""

    exit_code = 5


class UnknownName(HpopError, LookupError):
    """No criterion, planner or model has this name."""

    exit_code = 7


class CriterionError(HpopError, ValueError):
    """A criterion is declared wrongly, or its cost is not a finite non-negative number a motion."""

    exit_code = 8


class UnsupportedCriterion(CriterionError):
    """A planner cannot treat this criterion; the message names one that can."""


class ModelError(HpopError, ValueError):
    """A robot model's parameters make no sense."""

    exit_code = 9


class UnsupportedModel(ModelError):
    """A planner cannot plan for this model; the message names planners that can."""


class OptionError(HpopError, ValueError):
    """A planner or a search was given an option that makes no sense."""

    exit_code = 10


class GraphError(HpopError, ValueError):
    """A graph is malformed: wrong shapes, negative costs, nodes out of range, costs that would overflow."""

    exit_code = 11


class OutputError(HpopError, OSError):
    """A result cannot be written, or a saved one cannot be read."""

    exit_code = 12


class LimitError(HpopError):
    """The limits of all planners were passed while the map was read: there is nothing yet to return a status with."""

    exit_code = 13


class RosError(HpopError, ValueError):
    """A message of ROS is not what its type says, or what is asked of a bridge to ROS makes no sense."""

    exit_code = 15


class OwnCodeError(HpopError, ImportError):
    """Python of the user's own, named on the command line, cannot be imported, registers nothing, or fails."""

    exit_code = 14


class DriveError(HpopError, ValueError):
    """What a drive is told or asked makes no sense: a door that is not there, a wish for no cost, a time gone by."""

    exit_code = 16


class CoversRobot(DriveError):
    """What is closed on a drive covers the robot, from where nothing could be planned then."""


class StudyError(HpopError, ValueError):
    """A study's design, its answers or a questionnaire are not what they should be, or contradict one another."""

    exit_code = 17


MOST_LETTERS = 100
"""Of a name that is compared with others."""
OWN = "import its module first (on the command line --import FILE_OR_MODULE) or install its package."


def unknown_name(kind: str, name: str, known: Iterable[str]) -> UnknownName:
    """Build the error that suggests the nearest of the known names, lists them, and says how one's own gets known.

    >>> print(unknown_name("criterion", "turn", ["turns", "length"]))  # doctest: +NORMALIZE_WHITESPACE
    unknown criterion 'turn'. Did you mean 'turns'? Known: length, turns.
    For one of your own, import its module first (on the command line --import FILE_OR_MODULE) or install its package.
    """
    names = sorted(known)
    return UnknownName(
        f"unknown {kind} {shown(name)}.{did_you_mean(name, names)} Known: {', '.join(names) or 'none'}. "
        f"For one of your own, {OWN}"
    )


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """Ask whether the nearest known name was meant; nothing where none is near.

    >>> did_you_mean("lenght", ["turns", "length"]), did_you_mean("mood", ["turns", "length"])
    (" Did you mean 'length'?", '')
    """
    near = (
        difflib.get_close_matches(name, list(known), n=1) if isinstance(name, str) and len(name) < MOST_LETTERS else []
    )
    return f" Did you mean {near[0]!r}?" if near else ""


def own_place(error: BaseException) -> str:
    """File and line of an error in the innermost of the user's code; "" where none of it is known to be involved."""
    if isinstance(error, SyntaxError) and error.filename and Path(error.filename).is_file():
        return f"{error.filename}, line {error.lineno}" if error.lineno else error.filename
    libraries = [Path(__file__).parent, *(Path(sysconfig.get_path(key)) for key in ("stdlib", "purelib", "platlib"))]
    for frame in reversed(extract_tb(error.__traceback__)):
        file = Path(frame.filename)
        if file.is_file() and not any(file.is_relative_to(library) for library in libraries):
            return f"{file}, line {frame.lineno}"
    return ""


def own_failure(what: str, error: BaseException) -> str:
    """What is said of the user's code that raised an error: where, and which.

    >>> own_failure("criterion 'mine'", ZeroDivisionError("division by zero"))
    "criterion 'mine' failed: ZeroDivisionError: division by zero"
    """
    place = own_place(error)
    said = ": ".join(filter(None, (type(error).__name__, str(error))))
    return f"{what} failed{f' ({place})' if place else ''}: {said}"
