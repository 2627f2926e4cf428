"""The explorer in a notebook: what is chosen in the page is at hand in Python."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.lazy import library
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.view.explorer.payload import SCRIPT, payload
from hpop.view.single_page import bundle, single_page

MODULE = "widget.js"
HEIGHT = 900  # pixels


@checked_arguments
def widget(problem: Problem, front: Front, *, title: str | None = None, height: int = HEIGHT) -> Any:
    """A widget of the explorer, as the last value of a cell; needs the extra ``notebook``.

    While it is shown ``selected`` (rows), ``hovered`` (a row or None) and ``pinned`` (rows, A first) follow what is
    done in the page, and ``chosen`` is the front of the selected rows. ``observe`` calls a function when one changes.

    Parameters
    ----------
    problem : Problem
        World, model, start and goal.
    front : Front
        Its trajectories.
    title : str, optional
        What the page is called; by default which costs are traded.
    height : int
        Of the page, pixels.

    Raises
    ------
    ImportError
        If anywidget is not installed; it says how to get it.
    """
    given = payload(problem, front, title=title)
    page = single_page(SCRIPT, given["title"], {**given, "embedded": True})
    return _explorer()(front, page=page, height=height, selected=list(range(len(front))))


@cache
def _explorer() -> type[Any]:
    """The widget's class, whose base is of the extra."""
    base: Any = library("anywidget", "hpop.view.widget", "notebook").AnyWidget
    traitlets = library("traitlets", "hpop.view.widget", "notebook")

    class Explorer(base):  # type: ignore[misc]  # of a package that may not be there
        """The explorer of a front in a notebook."""

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
            """The front of the rows that are selected."""
            return self.front[np.isin(np.arange(len(self.front)), self.selected)]

    return Explorer
