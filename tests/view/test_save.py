from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
import shapely
from PIL import Image

from hpop import DifferentialDrive, Problem, World
from hpop.errors import OutputError
from hpop.planners.spending import Spending
from hpop.runtime import limits
from hpop.runtime.limits import Budget
from hpop.view import draw_front, draw_map, draw_trace, draw_where, save_pictures
from hpop.world.content.content import Landmark


@pytest.fixture
def problem(make_problem):
    return make_problem(["exposure", "turns", "length"])


@pytest.fixture
def empty(problem, make_front):
    """Return a front whose only picture is the map."""
    return make_front(problem, costs=np.zeros((0, 3)), status="no path")


@pytest.mark.proof
def test_four_pictures_of_the_size_of_their_figures_as_savefig_makes_them_in_two_drawings(
    problem, make_front, tmp_path
):
    """Each is drawn once; of two of them it is looked at whether it is all the same as drawn twice."""
    front = make_front(problem)
    paths = save_pictures(problem, front, tmp_path / "new" / "folder", dpi=40)
    assert [path.name for path in paths] == ["map.png", "front.png", "trace.png", "where.png"]
    assert sorted(os.listdir(tmp_path / "new" / "folder")) == ["front.png", "map.png", "trace.png", "where.png"]
    knee = front.knee().item
    figures = (
        *(draw_map(problem, front), draw_front(front)),
        *(draw_trace(problem, knee), draw_where(problem, knee, name="the knee")),
    )
    for path, figure in zip(paths, figures, strict=True):
        with Image.open(path) as image:
            assert image.size == pytest.approx(figure.get_size_inches() * 40, abs=1)
            colours = np.asarray(image.convert("RGB")).reshape(-1, 3)
        assert len(np.unique(colours, axis=0)) > 50
        if path.stem in ("front", "where"):
            figure.savefig(tmp_path / "two.png", dpi=40)
            once, twice = (Image.open(picture).convert("RGB") for picture in (path, tmp_path / "two.png"))
            assert (np.asarray(once) == np.asarray(twice)).all()


def test_the_resolution_is_good_enough_for_print(problem, empty, tmp_path):
    with Image.open(save_pictures(problem, empty, tmp_path)[0]) as image:
        assert image.info["dpi"] == pytest.approx((200, 200), abs=0.1)
        assert min(image.size) > 1200


def test_who_stays_where_he_is_has_no_trace(make_problem, tmp_path):
    problem = make_problem(["turns", "length"], goal=(1, 1, 0))
    front = problem.solve("lattice", step=1.0)
    assert [path.name for path in save_pictures(problem, front, tmp_path, dpi=50)] == ["map.png", "front.png"]


def test_an_empty_front_gives_the_map_alone(problem, empty, tmp_path):
    for name in ("trace.png", "side.png", "states.png"):
        (tmp_path / name).write_text("of an earlier front")
    assert [path.name for path in save_pictures(problem, empty, tmp_path, dpi=50)] == ["map.png"]
    assert os.listdir(tmp_path) == ["map.png"]


def test_a_field_that_takes_more_memory_than_it_may_is_left_out_and_the_map_says_so(problem, empty, tmp_path):
    ground = replace(problem.world.ground)  # of which nothing is made yet
    problem = replace(problem, world=replace(problem.world, ground=ground))
    assert len(save_pictures(problem, empty, tmp_path, dpi=50, max_memory=10_000)) == 1
    assert not any(key[0] == "obstruction" for key in ground.cache._values)
    with limits.within(Spending(Budget(max_memory=10_000))):
        (legend,) = (legend for legend in draw_map(problem, empty).legends)
    assert any("left out:\nit takes more than max_memory" in text.get_text() for text in legend.get_texts())
    draw_map(problem, empty)
    assert any(key[0] == "obstruction" for key in ground.cache._values)


def test_the_field_of_a_map_so_large_that_its_ball_is_no_pixel_is_not_sampled(empty):
    """A field of balls of 2 m over 100 km would be 25 million samples 17 m apart, which show nothing."""
    world = World.from_polygons([shapely.box(45e3, 30e3, 55e3, 45e3)], extent=shapely.box(0, 0, 100e3, 75e3))
    country = Problem(world, DifferentialDrive(), (12.5e3, 37.5e3, 0.0), (87.5e3, 37.5e3, 0.0), ["exposure", "turns"])
    (legend,) = draw_map(country, empty).legends
    assert any("left out:\nits ball is smaller than a pixel" in text.get_text() for text in legend.get_texts())
    assert not any(key[0] == "obstruction" for key in world.ground.cache._values)


def test_pictures_that_are_there_are_replaced(problem, empty, tmp_path):
    (tmp_path / "map.png").write_text("old")
    save_pictures(problem, empty, tmp_path, dpi=50)
    with Image.open(tmp_path / "map.png") as image:
        image.verify()


def test_a_folder_that_is_a_file_is_an_output_error(problem, empty, tmp_path):
    (tmp_path / "taken").write_text("text")
    with pytest.raises(OutputError, match="taken"):
        save_pictures(problem, empty, tmp_path / "taken", dpi=50)
    assert (tmp_path / "taken").read_text() == "text"


def test_a_failed_write_leaves_the_old_picture_and_nothing_else(problem, empty, tmp_path, monkeypatch):
    (tmp_path / "map.png").write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OutputError, match="No space left"):
        save_pictures(problem, empty, tmp_path, dpi=50)
    assert os.listdir(tmp_path) == ["map.png"]
    assert (tmp_path / "map.png").read_text() == "old"


def test_no_module_of_hpop_imports_pyplot(warm, tmp_path):
    code = "import sys; print('hpop.view.save' in sys.modules, 'matplotlib.pyplot' in sys.modules)"
    assert warm.run(cwd=tmp_path, code=code).stdout == "True False\n"


def test_names_in_letters_that_the_font_lacks_are_drawn_without_a_warning(problem, empty, tmp_path):
    x, y, _ = problem.start
    named = replace(problem, world=problem.world.with_content(landmarks=[Landmark(x, y, name="\u6f22\u5b57")]))
    (path,) = save_pictures(named, empty, tmp_path, dpi=20)
    assert path.name == "map.png"


@pytest.mark.parametrize("most", [10_000, 10**9])
def test_where_no_limit_is_given_there_is_one(problem, empty, tmp_path, monkeypatch, most):
    """The field of a fine image took two gigabytes, of a front that took half of one."""
    monkeypatch.setattr("hpop.view.save.MOST_FIELD", most)
    ground = replace(problem.world.ground)  # of which nothing is made yet
    save_pictures(replace(problem, world=replace(problem.world, ground=ground)), empty, tmp_path, dpi=30)
    assert any(key[0] == "obstruction" for key in ground.cache._values) == (most == 10**9)
