"""The explorer in a notebook: what the page tells arrives in Python, by the widget's own traits."""

from __future__ import annotations

import json
import re
import sys

import numpy as np
import pytest

from hpop.view import save as home
from hpop.view import widget
from hpop.view.single_page import bundle
from tests.view.explorer.decoder import Page


@pytest.fixture
def problem(make_problem):
    return make_problem(["turns", "length"])


@pytest.fixture
def front(problem, make_front):
    return make_front(problem, costs=np.array([[0.0, 3], [1, 2], [2, 1]]))


def test_a_notebook_is_given_the_module_and_the_page_of_the_front(problem, front):
    shown = widget(problem, front, title="Room", height=700)
    state = shown.get_state()
    assert (state["_esm"], state["height"]) == (bundle("widget.js"), 700)
    held = re.search(r'id="payload">(.*?)</script>', state["page"])
    assert held is not None
    page = Page(json.loads(held[1]))
    assert (page.raw["title"], page.raw["embedded"]) == ("Room", True)
    assert page.columns["length"].tolist() == front.costs[:, 1].tolist()
    shown.close()


def test_what_is_chosen_in_the_page_is_at_hand_in_python(problem, front):
    shown = widget(problem, front)
    assert (shown.selected, shown.hovered, shown.pinned) == (list(range(len(front))), None, [])
    assert len(shown.chosen) == len(front) > 1
    heard = []
    shown.observe(lambda change: heard.append(change["new"]), "selected")
    shown.set_state({"selected": [1], "hovered": 1, "pinned": [0]})  # as a notebook's front end sends it
    assert (heard, shown.hovered, shown.pinned) == ([[1]], 1, [0])
    assert shown.chosen.costs.tolist() == front.costs[1:2].tolist()
    shown.set_state({"selected": []})
    assert len(shown.chosen) == 0
    shown.close()


def test_without_the_extra_the_error_says_how_to_get_it(problem, front, monkeypatch):
    monkeypatch.setitem(sys.modules, "anywidget", None)
    home._explorer.cache_clear()
    with pytest.raises(ImportError, match=r"hpop\.view\.widget needs anywidget.*pip install 'hpop\[notebook\]'"):
        widget(problem, front)
