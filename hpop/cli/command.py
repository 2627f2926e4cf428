"""What all commands share: the option for code of the user's own, and errors that end in one message."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar, cast

import click

from hpop.cli.terminal import echo, warnings_as_notes
from hpop.errors import NOTE, HpopError, OwnCodeError, own_failure, own_place
from hpop.runtime.interrupts import endings_interrupt

NO_PATH = 6
NOTHING_FOUND = 13
INTERRUPTED = 130
F = TypeVar("F", bound=Callable[..., Any])

imports_option = click.option(
    "--import",
    "imports",
    metavar="FILE_OR_MODULE",
    multiple=True,
    help="Python of your own, FILE.py or a module: criteria, planners, models, goals, readers, formats. Repeatable.",
)

verbose_option = click.option(
    "--verbose", is_flag=True, help="Print also what was counted: labels, edges, seconds, memory."
)

preference_option = click.option(
    "--preference",
    "person",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="What somebody prefers, as `hpop prefer` wrote it: their best trajectory is marked.",
)


def user_errors(command: F) -> F:
    """A user's mistake ends in one message and its exit code, never in a traceback."""

    @wraps(command)
    def guarded(*args: Any, **kwargs: Any) -> Any:
        try:
            with endings_interrupt(), warnings_as_notes():
                return command(*args, **kwargs)
        except HpopError as error:
            code, text = error.exit_code, str(error)
            for note in getattr(error, "__notes__", ()):
                text += f"\n{note}" if note.startswith(NOTE) else f"; {note}"
        except KeyboardInterrupt:
            code, text = INTERRUPTED, "interrupted"
        except MemoryError:
            code, text = HpopError.exit_code, "out of memory; take a larger step, fewer criteria, or set max_memory"
        except Exception as error:  # of what else the user's own code does; without any it is a bug, and shows itself
            if not ((kwargs.get("imports") or kwargs.get("plugin")) and own_place(error)):
                raise
            code, text = OwnCodeError.exit_code, own_failure("code of your own", error)
        echo(f"error: {text}", err=True)
        sys.exit(code)

    return cast(F, guarded)
