"""Notebooks show tables of what exists, small pictures once they can be drawn, and figures by themselves."""

from __future__ import annotations

import base64
import io
import re
from xml.etree import ElementTree

import pytest
from PIL import Image

from hpop.base.table import PICTURES, facts_html, picture_html, table_html
from hpop.scenario import load_scenario
from hpop.view import draw_front
from hpop.view.save import small_map
from hpop.world import World
from tests.test_reprs import EXAMPLES


def picture_in(html: str) -> Image.Image:
    (data,) = re.findall(r'<img alt="Picture of a [A-Z][a-z]+" src="data:image/png;base64,([^"]+)">', html)
    return Image.open(io.BytesIO(base64.b64decode(data)))


def table_in(html: str) -> list[list[str]]:
    """Cells of all rows, as a browser reads them."""
    whole = ElementTree.fromstring(f"<div>{html.partition('<img ')[0]}</div>")
    return [["".join(cell.itertext()) for cell in row] for row in whole.iter("tr")]


@pytest.fixture
def problem(make_problem):
    return make_problem()


def test_a_world_tells_its_size_and_what_is_in_it(world):
    html = world._repr_html_()
    assert ["size", "10 x 8 m from (0, 0)"] in table_in(html)
    assert ["obstacles", "3"] in table_in(html)
    assert picture_in(html).width > 200


def test_a_problem_tells_what_is_asked(problem):
    html = problem._repr_html_()
    assert ["criteria", "turns, length (m)"] in table_in(html)
    assert ["start", "(1, 1, 0)"] in table_in(html)
    assert picture_in(html).width > 200


def test_a_front_tells_the_points_worth_a_name_and_what_is_claimed(problem, make_front):
    front = make_front(problem)
    html = front._repr_html_()
    rows = table_in(html)
    assert rows[0] == ["#", "turns", "length (m)", "obstruction", ""]
    knee = front.knee()
    (row,) = (row for row in rows if row[0] == str(knee.index) and "knee" in row[-1])
    assert row[1] == f"{knee.costs['turns']:g}"
    assert ["certificate", front.certificate] in rows
    assert picture_in(html).width > 200
    assert "<img" not in front[:0]._repr_html_()


def test_without_what_draws_there_is_a_hint_and_a_table(world, monkeypatch):
    monkeypatch.delitem(PICTURES, World)
    html = world._repr_html_()
    assert "<img" not in html
    assert "import hpop.view" in html
    assert ["obstacles", "3"] in table_in(html)


def test_names_out_of_files_are_text():
    """A browser would run what a map's name, a criterion or a certificate holds."""
    evil = "<script>alert(1)</script>\x1b[2J"
    for html in (table_html([evil], [[evil]], evil), facts_html([(evil, evil)])):
        assert "<script" not in html
        assert "\x1b" not in html
    assert "<img" not in picture_html(object())


def test_the_small_map_has_start_and_goal_of_a_problem_alone(world, problem):
    texts = [text.get_text() for text in small_map(world, problem).axes[0].texts]
    assert {"S", "G"} <= set(texts)
    assert not {"S", "G"} & {text.get_text() for text in small_map(world).axes[0].texts}


def test_an_arm_and_a_goal_that_is_no_state_have_a_picture():
    assert picture_in(load_scenario(EXAMPLES / "arm_shelf.yaml").problem._repr_html_()).width > 200


def test_a_figure_shows_itself(problem, make_front):
    shown = Image.open(io.BytesIO(draw_front(make_front(problem))._repr_png_()))
    assert shown.format == "PNG"
    assert shown.width > 300
