"""Explorer page of a front, saved as an HTML file, or shown as a widget in a notebook."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.files import replacing
from hpop.base.lazy import library
from hpop.errors import OutputError
from hpop.frontier.choices import Preferring
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.view.explorer.payload import SCRIPT, payload
from hpop.view.single_page import bundle, page_file, single_page
from hpop.world.files import place_seen_from


@checked_arguments
def save_explorer(
    problem: Problem,
    front: Front,
    path: str | os.PathLike[str],
    *,
    title: str | None = None,
    saved: str | os.PathLike[str] | None = None,
    preference: Preferring | None = None,
) -> Path:
    """Write a web page to choose a trajectory from a front, and return its path.

    The page has linked axes of costs, a map, a table, and charts along trajectories. It is one file, which any current
    browser opens from the disk without a network. The folder is created if missing; an existing page is replaced.

    Parameters
    ----------
    problem : Problem
        World, model, start and goal.
    front : Front
        Its trajectories; none, one or thousands: 8,000 are a page of 2 MB at most.
    path : path
        The file, such as "front.html".
    title : str, optional
        Title of the page; by default the traded costs.
    saved : path, optional
        The file that holds the front, for the Python code that the page offers. It is shown as given, but an absolute
        path, which may contain a user's name, becomes relative to the page's folder.
    preference : Preference, optional
        Preference of a person: the best trajectory for this person is marked "for you".

    Raises
    ------
    OptionError
        If the file's name does not end in .html.
    OutputError
        If the file cannot be written, or its folder cannot be created. No partial file remains.
    """
    target = page_file(path)
    place = None if saved is None else os.fspath(saved)
    if place is not None and os.path.isabs(place):
        place = place_seen_from(str(target.parent.absolute()), place)
    given = payload(problem, front, title=title, saved=place, preference=preference)
    page = single_page(SCRIPT, given["title"], given).encode(errors="backslashreplace")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with replacing(target) as file:
            file.write(page)
    except OSError as error:
        raise OutputError(
            f"the explorer cannot be written to {target}: {error.strerror or error}; choose another file"
        ) from error
    return target


MODULE = "widget.js"
HEIGHT = 900  # pixels


@checked_arguments
def widget(problem: Problem, front: Front, *, title: str | None = None, height: int = HEIGHT) -> Any:
    """Return the explorer as a notebook widget, which a cell shows as its last value; needs ``hpop[notebook]``.

    While the widget is shown, its attributes follow the page: ``selected`` (rows), ``hovered`` (a row or None) and
    ``pinned`` (rows, A first). ``chosen`` is the front of the selected rows. ``observe`` registers a function that is
    called at changes.

    Parameters
    ----------
    problem : Problem
        World, model, start and goal.
    front : Front
        Its trajectories.
    title : str, optional
        Title of the page; by default the traded costs.
    height : int
        Height of the page, pixels.

    Raises
    ------
    ImportError
        If anywidget is not installed; the message says how to install it.
    """
    given = payload(problem, front, title=title)
    page = single_page(SCRIPT, given["title"], {**given, "embedded": True})
    return _explorer()(front, page=page, height=height, selected=list(range(len(front))))


@cache
def _explorer() -> type[Any]:
    """Return the widget's class, defined at first use because its base class is in an optional package."""
    base: Any = library("anywidget", "hpop.view.widget", "notebook").AnyWidget
    traitlets = library("traitlets", "hpop.view.widget", "notebook")

    class Explorer(base):  # type: ignore[misc]  # of a package that may not be there
        """Explorer of a front as a notebook widget."""

        _esm = bundle(MODULE)
        page = traitlets.Unicode().tag(sync=True)
        height = traitlets.Int().tag(sync=True)
        selected = traitlets.List(traitlets.Int()).tag(sync=True)
        hovered = traitlets.Int(None, allow_none=True).tag(sync=True)
        pinned = traitlets.List(traitlets.Int()).tag(sync=True)

        def __init__(self, front: Front, **shown: Any) -> None:
            super().__init__(**shown)
            self.front = front

        @property
        def chosen(self) -> Front:
            """The front that consists of the selected rows."""
            return self.front[np.isin(np.arange(len(self.front)), self.selected)]

    return Explorer
