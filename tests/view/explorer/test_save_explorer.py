"""The explorer's file: whole or not at all, what it is called, and the payload in it."""

from __future__ import annotations

import pytest

import hpop
from hpop.errors import OutputError
from hpop.view import save_explorer
from tests.view.explorer.decoder import held

ODD = "</script><b>\N{RIGHT-TO-LEFT OVERRIDE}"


@pytest.fixture
def problem(make_problem) -> hpop.Problem:
    return make_problem(["turns", "length"])


@pytest.fixture
def front(problem, make_front) -> hpop.Front:
    return make_front(problem)


def test_the_folder_is_made_and_the_page_holds_the_front(problem, front, tmp_path):
    path = save_explorer(problem, front, tmp_path / "new" / "folder" / "front.html", saved="out/front.json")
    assert path == tmp_path / "new" / "folder" / "front.html"
    assert [each.name for each in path.parent.iterdir()] == ["front.html"]
    page = held(path)
    assert page.columns["length"].tolist() == front.costs[:, 1].tolist()
    assert page.raw["saved"] == "out/front.json"
    assert page.raw["title"] == "Trade-offs between turns and length"


def test_a_title_of_markup_stays_text(problem, front, tmp_path):
    path = save_explorer(problem, front, tmp_path / "a.html", title=ODD)
    text = path.read_text(encoding="utf-8")
    assert "<title>&lt;/script&gt;&lt;b&gt;\\u202e</title>" in text
    assert "</script><b>" not in text
    assert held(path).raw["title"] == "</script><b>\\u202e"


def test_what_cannot_be_written_leaves_what_was_there(problem, front, tmp_path):
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(OutputError, match=r"cannot be written to .*file.front\.html: .*; choose another file"):
        save_explorer(problem, front, tmp_path / "file" / "front.html")
    (tmp_path / "front.html").mkdir()
    with pytest.raises(OutputError, match="choose another file"):
        save_explorer(problem, front, tmp_path / "front.html")
    assert {path.name for path in tmp_path.iterdir()} == {"file", "front.html"}


def test_one_page_replaces_another(problem, front, tmp_path):
    for title in ("first", "second"):
        save_explorer(problem, front, tmp_path / "front.html", title=title)
    assert held(tmp_path / "front.html").raw["title"] == "second"
    assert len(list(tmp_path.iterdir())) == 1
