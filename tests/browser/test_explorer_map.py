"""The explorer's map: what is drawn where, densities that count trajectories, picking of those that share a place."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from playwright.sync_api import Page

import hpop
from benchmarks import seeded_fronts as seeded
from hpop.base.arrays import FloatArray
from hpop.scenario import load_scenario
from hpop.world.content.content import Landmark, Person, Zone
from hpop.world.fields.measured import MeasuredField
from tests.browser import explored
from tests.browser.conftest import Watched
from tests.browser.explored import state

Point = tuple[float, float]
UPPER: list[Point] = [(1, 4), (3, 4), (3, 7), (9, 7), (9, 4), (11, 4)]
LOWER: list[Point] = [(1, 4), (3, 4), (3, 1), (9, 1), (9, 4), (11, 4)]
STRAIGHT: list[Point] = [(1, 4), (11, 4)]
WAYS = [UPPER] * 5 + [LOWER] * 3 + [STRAIGHT]
MARGIN = 14  # CSS pixels round the whole


def along(points: list[Point]) -> hpop.Trajectory:
    """Straight from place to place."""
    poses = [(*b, float(np.arctan2(b[1] - a[1], b[0] - a[0]))) for a, b in pairwise(points)]
    return hpop.Trajectory.from_poses(hpop.DifferentialDrive(), [(*points[0], 0.0), *poses])


def front_of(ways: list[list[Point]]) -> hpop.Front:
    """Return a front of mutually non-dominated rows, one for each path."""
    n = len(ways)
    made = [along(way) for way in ways]
    costs = np.stack([np.arange(1.0, n + 1), np.arange(n, 0.0, -1)], axis=1)
    return hpop.Front.of(
        costs, made, names=["turns", "length"], units=["1", "m"], quanta=[1.0, 1e-6], status="complete"
    )


def problem_in(world: hpop.World, start: Point, goal: Point) -> hpop.Problem:
    return hpop.Problem(world, hpop.DifferentialDrive(), (*start, 0), (*goal, 0), ["turns", "length"])


@dataclass
class Map:
    """The map of a page, in metres."""

    page: Page

    def pixel(self, x: float, y: float) -> Point:
        """Return the CSS pixel of a position when the plot shows the whole map: as large as fits, in the middle."""
        width, height = self.page.eval_on_selector(".map .plot", "e => [e.clientWidth, e.clientHeight]")
        x0, y0, x1, y1 = state(self.page, "s.model.world.view")
        scale = min((width - 2 * MARGIN) / (x1 - x0), (height - 2 * MARGIN) / (y1 - y0))
        return width / 2 + scale * (x - (x0 + x1) / 2), height / 2 - scale * (y - (y0 + y1) / 2)

    def on_screen(self, x: float, y: float) -> Point:
        box = self.page.locator(".map .plot").bounding_box()
        assert box is not None
        px, py = self.pixel(x, y)
        return box["x"] + px, box["y"] + py

    def colour(self, x: float, y: float, layer: str = "base", aside: Point = (0, 0)) -> FloatArray:
        """Red, green, blue, opacity at a place, or so many pixels aside."""
        return self._pixels(x, y, layer, aside, 0)[0]

    def line_colour(self, x: float, y: float) -> FloatArray:
        """Return the darkest colour of a pixel and its neighbours: a line is one pixel wide."""
        near = self._pixels(x, y, "base", (0, 0), 1)
        return near[near[:, :3].sum(axis=1).argmin()]

    def _pixels(self, x: float, y: float, layer: str, aside: Point, round_it: int) -> FloatArray:
        px, py = self.pixel(x, y)
        side = 2 * round_it + 1
        where = [int(px + aside[0]) - round_it, int(py + aside[1]) - round_it, side, side]
        js = "(e, where) => [...e.getContext('2d').getImageData(...where).data]"
        found = self.page.eval_on_selector(f".map .{layer}", js, where)
        return np.array(found, dtype=np.float64).reshape(-1, 4)

    def picture(self) -> FloatArray:
        """All of the base after the next frame, (pixels, 4)."""
        self.page.evaluate(explored.FRAME)
        return explored.pixels(self.page, ".map .base").reshape(-1, 4)


def alike(one: FloatArray, other: FloatArray) -> bool:
    """Compare two pictures except for the edges of letters, which a browser smooths as it likes."""
    return bool(np.any(one != other, axis=1).mean() < 0.003)


@pytest.fixture(scope="module")
def shared(opened_once: Watched, tmp_path_factory: pytest.TempPathFactory) -> Page:
    """One page for the claims about one map with everything on it."""
    people = [Person(10.5, 6.5, 0.0, name="Ann"), Person(10.5, 5.5, np.pi / 2), Person(11.3, 2.5, velocity=(0.0, 0.5))]
    way = shapely.LineString([(1.1, 5), (1.1, 7.8)])
    zones = [
        Zone("speed", shapely.box(4, 2, 8, 3), limit=0.4, name="slow"),
        Zone("one-way", shapely.box(0.2, 5, 2, 7.8), path=way),
    ]
    world = hpop.World.from_polygons(
        [
            shapely.box(4, 5, 8, 6),
            shapely.box(6.8, 5.2, 7.2, 5.8).reverse(),
            (shapely.box(10, 0.2, 11, 1), (0.0, 0.4)),
            (shapely.box(10.4, 0.3, 10.8, 0.9), (0.0, 0.4)),
        ],
        extent=shapely.box(0, 0, 12, 8),
        keep_out=shapely.box(0, 0, 2, 1.5),
    ).with_content(people=people, groups=[(0, 1)], landmarks=[Landmark(10.5, 2.0, facing=np.pi / 2)], zones=zones)
    path = tmp_path_factory.mktemp("map") / "front.html"
    explored.written(problem_in(world, (1, 4), (11, 4)), front_of(WAYS), path)
    return opened_once(path)


@pytest.fixture
def plane(shared: Page) -> Map:
    explored.fresh(shared)
    shared.mouse.move(2, 2)
    return Map(shared)


def bluish(colour: FloatArray) -> bool:
    return bool(colour[2] - colour[0] > 30)


def grey(colour: FloatArray) -> bool:
    return bool(np.ptp(colour[:3]) < 12 and colour[:3].mean() < 240)


@pytest.mark.proof
def test_each_distinct_run_is_drawn_once_as_numpy_counts_them(plane: Map) -> None:
    runs = {frozenset(run) for way in WAYS for run in pairwise(way)}
    assert plane.page.get_attribute(".map .plot", "data-segments") == str(len(runs)) == "9"


def test_a_run_is_as_dark_as_the_trajectories_that_pass_it_are_many(plane: Map) -> None:
    # By nine at the entry (the straight way leads over the same floor), five above, three below, one between.
    places = [(2, 4), (6, 7), (6, 1), (6, 4)]
    passing = [sum(shapely.LineString(way).distance(shapely.Point(place)) < 1e-9 for way in WAYS) for place in places]
    assert passing == [9, 5, 3, 1]
    colours = [plane.line_colour(*place) for place in places]
    assert all(bluish(colour) for colour in colours)
    assert np.all(np.diff([colour[:3].sum() for colour in colours]) > 20)
    # Equal counts, equal colours: the two runs of the upper way.
    assert plane.line_colour(6, 7).tolist() == plane.line_colour(3, 5.5).tolist() == plane.line_colour(9, 5.5).tolist()


def test_what_is_not_selected_stays_grey_behind_the_selected(plane: Map) -> None:
    plane.page.evaluate("window.hpop.state.bound(0, { low: 6, high: 8 })")  # turns: the three lower ones
    plane.page.evaluate(explored.FRAME)
    assert grey(plane.line_colour(6, 7))
    assert grey(plane.line_colour(6, 4))
    assert bluish(plane.line_colour(6, 1))
    assert bluish(plane.line_colour(2, 4))


def test_walls_floor_zones_people_landmarks_and_ends_are_where_they_are(plane: Map) -> None:
    floor, wall = plane.colour(7, 2 - 0.5), plane.colour(7, 5.5)
    assert floor[:3].tolist() == [255, 255, 255]
    assert wall[:3].max() < 130
    assert plane.colour(-0.2, 4)[:3].max() < 245  # outside is no floor
    low = plane.colour(10.5, 0.6)
    assert wall[:3].max() < low[:3].max() < 230  # the camera sees over it: paler
    assert wall.tolist() == plane.colour(5, 5.5).tolist()  # two obstacles in one place are neither a hole
    assert low.tolist() == plane.colour(10.2, 0.6).tolist()  # nor twice as dark
    zone = plane.colour(4.2, 2.85)
    assert zone[0] > zone[2] + 15
    closed = [plane.colour(1, 0.75, aside=(dx, 0))[:3].sum() for dx in range(8)]
    assert min(closed) < 3 * 215 < max(closed)  # hatched
    start, goal = plane.colour(1, 4, aside=(-3, 0)), plane.colour(11, 4, aside=(-3, 0))
    assert start[:3].tolist() == [255, 255, 255]
    assert goal[0] > 200
    assert goal[1] > 200
    assert goal[2] < 110
    body = plane.colour(10.5, 6.5, aside=(-2, 0))
    assert body[1] > body[0] + 80  # green
    ahead, behind = plane.colour(10.5, 6.5, aside=(6, 0)), plane.colour(10.5, 6.5, aside=(-9, 0))
    assert ahead[:3].max() < 120 < behind[:3].min()  # the tick looks along x
    mark = plane.colour(10.5, 2.0, aside=(-2, 1))
    assert mark[0] > mark[2] + 80
    legend = plane.page.inner_text(".map .legend")
    assert all(word in legend for word in ("start", "goal", "person", "landmark", "sees over"))


@pytest.mark.proof
def test_the_floor_is_shaded_by_the_measured_field_of_a_criterion(opened_once: Watched, tmp_path: Path) -> None:
    """The field grows with y and is 0 outside; the legend says its range."""
    samples = np.repeat(np.linspace(0.0, 1.0, 9)[:, None], 13, axis=1)
    field = MeasuredField(samples, 1.0, name="dust", unit="g", outside=0.0)
    world = hpop.World.from_polygons([], extent=shapely.box(0, 0, 12, 8)).with_fields([field])
    criteria = ["turns", "length", {"time_below": {"field": "dust", "limit": 0.5, "width": 0.1}}]
    problem = hpop.Problem(world, hpop.DifferentialDrive(), (1, 4, 0), (11, 4, 0), criteria)
    page = opened_once(explored.written(problem, front_of(WAYS), tmp_path / "page.html"))
    explored.until(page, explored.READY)
    page.evaluate(explored.FRAME)
    shown = Map(page)
    low, middle, high = (shown.colour(10, y, "base") for y in (0.5, 3.0, 7.5))
    yellow = [colour[0] - colour[2] for colour in (low, middle, high)]  # red less blue: sand
    assert yellow[0] < yellow[1] < yellow[2]
    assert yellow[2] > 40
    assert "dust: 0" in page.inner_text(".map")


def test_hover_lists_all_that_pass_and_tab_goes_from_one_to_the_next(plane: Map) -> None:
    page = plane.page
    page.mouse.move(*plane.on_screen(6, 7))
    assert state(page, "s.hovered") == [0, 1, 2, 3, 4]
    assert "1 of 5 here" in page.inner_text(".picks")
    page.keyboard.press("Tab")
    assert state(page, "s.hovered") == [1, 2, 3, 4, 0]
    assert page.inner_text(".picks [aria-current]").startswith("row 1")
    page.keyboard.press("Shift+Tab")
    page.keyboard.press("Shift+Tab")
    assert state(page, "s.focus") == 4
    shown = ".map .plot", ".matrix .plot"
    assert [page.get_attribute(one, "data-highlighted") for one in shown] == ["4,0,1,2,3"] * 2
    assert page.get_attribute(".trace .plot", "data-focus") == "4"
    assert plane.colour(6, 7, "overlay")[:3].max() < 40
    x, y = plane.on_screen(6, 7)
    page.mouse.click(x, y)
    assert state(page, "s.pins") == [4, None, None]
    page.keyboard.press("Escape")
    assert state(page, "s.hovered") == []
    assert not page.is_visible(".picks")


@pytest.mark.proof
def test_hover_draws_no_base_anew_and_picks_only_what_is_selected(plane: Map) -> None:
    page = plane.page
    drawn = page.evaluate("window.hpop.counters.base.length")
    overlays = page.evaluate("window.hpop.counters.overlay.length")
    for x in (4, 5, 6):
        page.mouse.move(*plane.on_screen(x, 4))
        assert state(page, "s.hovered") == [8]
    page.mouse.move(*plane.on_screen(6, 2.5))
    assert state(page, "s.hovered") == []
    assert page.evaluate("window.hpop.counters.base.length") == drawn
    assert 2 <= page.evaluate("window.hpop.counters.overlay.length") - overlays <= 4
    page.evaluate("window.hpop.state.bound(0, { low: 6, high: 8 })")
    page.mouse.move(*plane.on_screen(2, 4))
    assert state(page, "s.hovered") == [5, 6, 7]


@pytest.mark.proof
def test_pins_are_drawn_in_their_colours_and_b_is_dashed(plane: Map) -> None:
    plane.page.evaluate("for (const row of [0, 5]) window.hpop.state.pin(row)")
    plane.page.evaluate(explored.FRAME)
    assert plane.colour(4, 7, "overlay")[:3].tolist() == [213, 94, 0]
    run = [plane.colour(4, 1, "overlay", (dx, 0))[:3].tolist() == [0, 114, 178] for dx in range(40)]
    assert 0.5 < np.mean(run) < 0.9


def test_wheel_keys_and_drag_move_the_map_and_0_shows_the_whole_again(plane: Map) -> None:
    page = plane.page
    whole = plane.picture()
    bar = page.get_attribute(".map .plot", "data-scale")
    page.mouse.move(*plane.on_screen(6, 5.5))
    page.evaluate("window.turned = 0; document.addEventListener('wheel', () => { window.turned++; })")
    for _ in range(3):
        page.mouse.wheel(0, -240)
    explored.until(page, "window.turned === 3")
    assert not alike(plane.picture(), whole)
    assert plane.colour(6, 5.5)[:3].max() < 130  # what was under the pointer stays there: the wall
    assert page.get_attribute(".map .plot", "data-scale") != bar
    page.focus(".map .plot")
    page.keyboard.press("0")
    assert alike(plane.picture(), whole)
    page.keyboard.press("ArrowLeft")
    page.evaluate(explored.FRAME)
    assert plane.colour(1, 4, aside=(60 - 3, 0))[:3].tolist() == [255, 255, 255]  # the start, 60 pixels to the right
    page.keyboard.press("ArrowRight")
    assert alike(plane.picture(), whole)
    page.mouse.move(*plane.on_screen(6, 2.5))
    page.mouse.down()
    x, y = plane.on_screen(6, 2.5)
    page.mouse.move(x + 30, y)
    page.mouse.move(x + 50, y + 20)
    page.mouse.up()
    page.evaluate(explored.FRAME)
    assert plane.colour(7, 5.5, aside=(50, 20))[:3].max() < 130
    assert state(page, "s.pins") == [None, None, None]  # a drag is no click
    page.click(".map button:text('Whole')")
    assert alike(plane.picture(), whole)


@pytest.mark.proof
def test_two_fingers_come_nearer_and_one_scrolls_the_page_past_the_whole(
    opened: Callable[..., Page], tmp_path: Path
) -> None:
    world = hpop.World.from_cells(np.kron(np.eye(4, dtype=bool), np.ones((4, 4), dtype=bool)), 0.5)
    way: list[Point] = [(1, 7), (1, 5.5), (7, 5.5), (7, 1)]
    path = explored.written(problem_in(world, way[0], way[-1]), front_of([way]), tmp_path / "front.html")
    page = opened(path, size=(390, 844), has_touch=True)
    explored.until(page, explored.READY)
    page.locator(".map .plot").scroll_into_view_if_needed()
    plane = Map(page)
    assert plane.colour(5, 5)[:3].max() < 130  # a cell of the raster
    assert plane.colour(3, 7)[:3].min() > 200
    bar = page.get_attribute(".map .plot", "data-scale")
    session = page.context.new_cdp_session(page)
    x, y = plane.on_screen(5, 5)

    def send(kind: str, *points: tuple[float, float]) -> None:
        fingers = [{"x": at[0], "y": at[1], "id": finger} for finger, at in enumerate(points)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": fingers})

    def touch(kind: str, apart: float) -> None:
        send(kind, *([] if kind == "touchEnd" else [(x - apart, y), (x + apart, y)]))

    def swiped_up() -> float:
        """Return by how many pixels the page scrolled when one finger moved up over the map."""
        before = page.evaluate("scrollY")
        send("touchStart", (x, y))
        for up in (10, 20, 40, 60, 80):
            send("touchMove", (x, y - up))
        send("touchEnd")
        page.evaluate(explored.FRAME)
        return page.evaluate("scrollY") - before

    touch("touchStart", 20)
    for apart in (25, 40, 60):
        touch("touchMove", apart)
    touch("touchEnd", 60)
    page.evaluate(explored.FRAME)
    assert plane.colour(5, 5)[:3].max() < 130  # what lies between the fingers stays there
    assert page.get_attribute(".map .plot", "data-scale") != bar
    page.touchscreen.tap(x, y - 1)  # on nothing
    assert state(page, "s.pins") == [None, None, None]
    assert swiped_up() == 0  # it is the map that moved
    page.click(".map button:text('Whole')")
    x, y = plane.on_screen(5, 5)
    assert swiped_up() > 20


@pytest.mark.proof
def test_a_map_of_five_kilometres(opened: Callable[..., Page], tmp_path: Path) -> None:
    world = hpop.World.from_polygons([shapely.box(2000, 1000, 3000, 2000)], extent=shapely.box(0, 0, 5000, 3000))
    way: list[Point] = [(100, 1500), (1500, 2500), (4900, 2500), (4900, 1500)]
    path = explored.written(problem_in(world, way[0], way[-1]), front_of([way]), tmp_path / "far.html")
    page = opened(path)
    explored.until(page, explored.READY)
    plane = Map(page)
    assert plane.colour(2500, 1500)[:3].max() < 130
    assert bluish(plane.line_colour(3000, 2500))
    assert page.get_attribute(".map .plot", "data-scale") == "1 km"
    page.mouse.move(*plane.on_screen(3000, 2500))
    assert state(page, "s.hovered") == [0]


def runs_of(trajectories: Iterable[hpop.Trajectory]) -> set[frozenset[Point]]:
    """Distinct straight runs of trajectories in whole millimetres, by NumPy: places where the heading changes."""
    runs = set()
    for trajectory in trajectories:
        places = np.round(np.stack([trajectory.states.x, trajectory.states.y], axis=1), 3)
        places = places[np.r_[True, np.any(np.diff(places, axis=0), axis=1)]]
        heading = np.arctan2(*np.diff(places, axis=0).T[::-1])
        corner = np.r_[True, np.abs(np.diff(heading)) > 1e-6, True]
        runs |= {frozenset(map(tuple, run.tolist())) for run in np.stack([places[corner][:-1], places[corner][1:]], 1)}
    return runs


@pytest.mark.proof
def test_the_distinct_runs_of_many_paths(opened: Callable[..., Page], tmp_path: Path) -> None:
    front = seeded.front(600, 3)
    page = opened(explored.written(seeded.problem(3), front, tmp_path / "front.html"), color_scheme="dark")
    explored.until(page, explored.READY)
    distinct = {id(trajectory): trajectory for trajectory in front.trajectories}.values()
    assert page.get_attribute(".map .plot", "data-segments") == str(len(runs_of(distinct)))


@pytest.mark.proof
def test_the_paths_of_the_museum_have_few_distinct_runs(opened: Callable[..., Page], tmp_path: Path) -> None:
    scenario = load_scenario(Path(__file__).parents[2] / "examples" / "museum.yaml")
    front = scenario.problem.solve(planner=list(scenario.planners))
    page = opened(explored.written(scenario.problem, front, tmp_path / "front.html"))
    explored.until(page, explored.READY)
    assert len(front) == 158
    assert page.get_attribute(".map .plot", "data-segments") == str(len(runs_of(front.trajectories))) == "211"
