"""What reaches the terminal: text may hold names and values out of files, so it is cleaned and cannot steer it."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from hpop.base.text import printable
from hpop.errors import HpopWarning


def echo(text: str, *, err: bool = False) -> None:
    """Print text of several lines."""
    click.echo(printable(text, newlines=True), err=err)


@contextmanager
def warnings_as_notes() -> Iterator[None]:
    """What hpop warns of is a note to whoever reads a terminal, without the line of Python that it comes from."""
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
    """Commands of which a wrong one is quoted as text that cannot steer the terminal."""

    def make_context(self, *args: Any, **kwargs: Any) -> click.Context:
        with _quoted():
            return super().make_context(*args, **kwargs)

    def invoke(self, context: click.Context) -> Any:
        with _quoted():
            return super().invoke(context)


@contextmanager
def _quoted() -> Iterator[None]:
    try:
        yield
    except click.ClickException as error:
        vars(error)["message"] = printable(error.message, newlines=True)
        raise


def open_page(page: Path) -> None:
    """Open a page in the user's browser, or say that there is none."""
    import webbrowser

    try:
        opened = webbrowser.open(page.absolute().as_uri())
    except (webbrowser.Error, OSError):
        opened = False
    if not opened:
        echo(f"no browser was found to open it; open {page} in one yourself", err=True)
