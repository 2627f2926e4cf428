"""Helpers for all commands: output that is safe for the terminal, common options, and one message per error.

Text may hold names and values from files, so control characters are escaped.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar, cast

import click

from hpop.base.text import printable
from hpop.errors import NOTE, HpopError, HpopWarning, OwnCodeError, own_failure, own_location
from hpop.runtime.interrupts import endings_interrupt


def echo(text: str, *, err: bool = False) -> None:
    """Print text, which may have several lines, with control characters escaped."""
    click.echo(printable(text, newlines=True), err=err)


@contextmanager
def warnings_as_notes() -> Iterator[None]:
    """Print warnings of hpop as notes on standard error, without the line of Python that caused them."""
    with warnings.catch_warnings():
        usual = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *rest: Any) -> None:
            if issubclass(category, HpopWarning):
                echo(f"note: {message}", err=True)
            else:
                usual(message, category, *rest)

        setattr(warnings, "showwarning", show)  # noqa: B010  (its type names arguments that are only handed on)
        yield


class Commands(click.Group):
    """Group of commands that escapes control characters in messages about wrong arguments."""

    def make_context(self, *args: Any, **kwargs: Any) -> click.Context:
        with _quoted():
            return super().make_context(*args, **kwargs)

    def invoke(self, context: click.Context) -> Any:
        with _quoted():
            return super().invoke(context)


@contextmanager
def _quoted() -> Iterator[None]:
    """Escape control characters in the message of a click error that is raised in the ``with`` block."""
    try:
        yield
    except click.ClickException as error:
        vars(error)["message"] = printable(error.message, newlines=True)
        raise


def open_page(page: Path) -> None:
    """Open a page in the browser; if there is no browser, print what to do."""
    import webbrowser

    try:
        opened = webbrowser.open(page.absolute().as_uri())
    except (webbrowser.Error, OSError):
        opened = False
    if not opened:
        echo(f"no browser was found to open it; open {page} in one yourself", err=True)


NO_PATH = 6
NOTHING_FOUND = 13
INTERRUPTED = 130
F = TypeVar("F", bound=Callable[..., Any])


def listed(context: click.Context, option: click.Parameter, given: Sequence[str]) -> list[str]:
    """Split the values of a repeated option at commas; return all names in one list."""
    names = [name.strip() for text in given for name in text.split(",")]
    if not all(names):
        raise click.BadParameter("expected names or numbers between commas, such as knee,3", context, option)
    return names


def rows_option(what: str) -> Callable[[F], F]:
    """Return the option --rows, which chooses rows of a front; ``what`` names them in its help text."""
    return click.option(
        "--rows",
        metavar="ROW,ROW",
        multiple=True,
        callback=listed,
        default=["knee"],
        help=f"{what}: numbers from `hpop show`, knee, or a criterion, for the row with its least value. [knee]",
    )


def points_option(words: str) -> Callable[[F], F]:
    """Return the option --points of a command; ``words`` say what it does there."""
    return click.option("--points", type=click.IntRange(1), metavar="N", help=words)


imports_option = click.option(
    "--import",
    "imports",
    metavar="FILE_OR_MODULE",
    multiple=True,
    help="Your own Python code, FILE.py or a module, with criteria, planners, models, goals, readers or formats. "
    "Repeatable.",
)

verbose_option = click.option(
    "--verbose", is_flag=True, help="Print statistics of the search too: labels, edges, seconds, memory."
)

preference_option = click.option(
    "--preference",
    "person",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Preference of a person, a file that `hpop prefer` wrote: the best trajectory for that person is marked.",
)


def user_errors(command: F) -> F:
    """Decorate a command: a mistake of the user ends it with one message and an exit code, without a traceback."""

    @wraps(command)
    def guarded(*args: Any, **kwargs: Any) -> Any:
        try:
            with endings_interrupt(), warnings_as_notes():
                return command(*args, **kwargs)
        except HpopError as error:
            code, text = error.exit_code, str(error)
            for note in getattr(error, "__notes__", ()):
                text = f"{text}\n{note}" if note.startswith(NOTE) else f"{text.removesuffix('.')}; {note}"
        except KeyboardInterrupt:
            code, text = INTERRUPTED, "interrupted"
        except MemoryError:
            code, text = HpopError.exit_code, "out of memory; take a larger step, fewer criteria, or set max_memory"
        except Exception as error:  # from the user's own code; without such code it is a bug and is shown
            if not ((kwargs.get("imports") or kwargs.get("plugin")) and own_location(error)):
                raise
            code, text = OwnCodeError.exit_code, own_failure("code of your own", error)
        echo(f"error: {text}", err=True)
        sys.exit(code)

    return cast(F, guarded)
