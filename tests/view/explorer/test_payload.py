"""The explorer's payload says what the front is, read by a decoder that shares nothing with what writes it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import shapely

import hpop
from hpop.motions import States
from hpop.view.explorer import payload
from hpop.view.single_page import single_page
from hpop.world.content.content import Landmark, Person, Zone
from hpop.world.fields.measured import MeasuredField
from tests.view.explorer.decoder import Page
from tests.view.explorer.fronts import seeded
from tests.view.robots import Lift, Reacher

ODD = "</script><b>\N{RIGHT-TO-LEFT OVERRIDE}ünï\x1b[2J"


@pytest.fixture
def problem(make_problem):
    return make_problem(["exposure", "turns", "length", "clearance", "openness"])


@pytest.fixture
def front(problem, make_front):
    return make_front(problem)


def through(model, **columns):
    return hpop.Trajectory.through(model, States(**{name: np.array(c, float) for name, c in columns.items()}))


def of(trajectories, problem):
    """Return a front of trajectories with arbitrary costs."""
    costs = [[i, len(trajectories) - i] for i in range(len(trajectories))]
    return hpop.Front.of(costs, trajectories, names=["length", "turns"], quanta=[1, 1], problem=problem.describe())


def test_costs_are_those_that_the_file_of_the_front_holds_bit_for_bit(tmp_path):
    problem, front = seeded(60)
    front.save(tmp_path / "front.json")
    held = json.loads((tmp_path / "front.json").read_text())
    page = Page(json.loads(json.dumps(payload(problem, front), allow_nan=False)))
    columns = held["points"]["costs"] | held["points"]["reported"]
    assert list(page.columns) == list(columns)
    for name, values in columns.items():
        assert page.columns[name].tolist() == values
    criteria = [column for column in page.raw["columns"] if not column["reported"]]
    assert [(c["name"], c["unit"], c["group"], c["quantum"]) for c in criteria] == [
        (c["name"], c["unit"], c["group"], c["quantum"]) for c in held["criteria"]
    ]
    assert (page.raw["count"], page.raw["status"]) == (60, "complete")


def assert_on_the_way(page: Page, row: int, trajectory: hpop.Trajectory) -> None:
    """Check that a decoded path is the camera's, seen from above, to 3 mm."""
    pose = trajectory.model.pose("camera", trajectory.at(np.linspace(0, trajectory.duration, 997)))
    way = np.stack([pose.x, pose.y], axis=1)
    drawn = page.path(row)
    if len(drawn) == 1:
        assert np.abs(way - drawn).max() < 3e-3
        return
    assert shapely.distance(shapely.points(way), shapely.LineString(drawn)).max() < 3e-3
    assert shapely.distance(shapely.points(drawn), shapely.LineString(way)).max() < 3e-3
    assert np.abs(drawn[[0, -1]] - way[[0, -1]]).max() < 1e-3
    assert shapely.LineString(drawn).length == pytest.approx(shapely.LineString(way).length, rel=1e-3, abs=1e-2)


def test_paths_are_those_of_the_camera_and_only_corners_are_kept(problem, front):
    page = Page(payload(problem, front))
    for row, trajectory in enumerate(front.trajectories):
        assert_on_the_way(page, row, trajectory)
    shortest = front.best("length").index
    assert page.path(shortest).tolist() == [[1.0, 1.0], [9.0, 1.0]] or page.counts[shortest] == 4
    assert len({tuple(place) for place in page.places.tolist()}) == len(page.places)


def test_a_path_of_many_steps_has_the_corners_of_its_runs(make_problem):
    model = hpop.DifferentialDrive()
    steps = [(1 + 0.25 * i, 1, 0) for i in range(9)] + [(3, 1 + 0.25 * i, np.pi / 2) for i in range(9)]
    front = of([hpop.Trajectory.from_poses(model, steps)], make_problem())
    assert Page(payload(make_problem(), front)).path(0).tolist() == [[1, 1], [3, 1], [3, 3]]


def test_a_way_there_and_back_keeps_its_turning_point(make_problem):
    way = hpop.Trajectory.from_poses(hpop.DifferentialDrive(), [(1, 1, 0), (4, 1, 0), (2, 1, 0)])
    front = of([way], make_problem())
    assert Page(payload(make_problem(), front)).path(0).tolist() == [[1, 1], [4, 1], [2, 1]]


def test_the_camera_of_an_arm_and_of_a_lift_and_of_curves_is_where_it_is_and_the_map_says_what_it_leaves_out(world):
    arm = Reacher()
    swings = [through(arm, waist=[0, 2.5, 1.0], shoulder=[0, 0.9, -0.3]), through(arm, waist=[0, -1], shoulder=[0, 1])]
    rises = [through(Lift(), x=[1, 2, 3], y=[1, 6, 7], yaw=[0, 1, 0], lift=[0, 1, 0.2])]
    for model, start, ways in ((arm, (0, 0), swings), (Lift(), (1, 1, 0, 0), rises)):
        problem = hpop.Problem(world, model, start, start, ["duration", "rotation"])
        page = Page(payload(problem, of(ways, problem)))
        for row, way in enumerate(ways):
            assert_on_the_way(page, row, way)
            where = model.pose("camera", way.at(page.traces[row]["t"])) if page.traces else None
            assert where is None or np.abs(page.traces[row]["places"][:, 0] - where.x).max() < 1e-2
        low, high = page.raw["world"]["heights"]
        assert high - low > 0.3
        assert "does not show" in page.raw["world"]["caption"]


def test_names_of_rows_are_those_of_the_command_line(problem, front):
    page = payload(problem, front)
    named = {name: mark["row"] for mark in page["marks"] for name in mark["names"]}
    assert named == {name: point.index for name, point in front.named().items()}


def test_traces_add_up_to_the_costs_and_go_where_the_camera_goes(problem, front):
    page = Page(payload(problem, front))
    assert {mark["row"] for mark in page.raw["marks"]} <= set(page.traces)
    for row, trace in page.traces.items():
        trajectory = front.trajectories[row]
        costs = problem.evaluate(trajectory)
        assert trace["t"][-1] == pytest.approx(trajectory.duration, abs=1e-3)
        pose = trajectory.model.pose("camera", trajectory.at(trace["t"]))
        assert np.abs(trace["places"] - np.stack([pose.x, pose.y], axis=1)).max() < 3e-3
        assert {name: adds for name, (adds, _) in trace["each"].items()} == {
            "exposure": "sum", "turns": "sum", "length": "sum", "clearance": "max", "openness": "mean",
        }  # fmt: skip
        for name, (adds, values) in trace["each"].items():
            mean = np.average(values, weights=np.diff(trace["t"]))
            total = {"sum": values.sum(), "max": values.max(), "mean": mean}[adds]
            assert total == pytest.approx(costs[name], rel=2e-3, abs=1e-6)


def test_the_rates_of_short_pieces_are_right(make_problem):
    problem = make_problem(["turns", "length"])
    x, y, _ = problem.start
    way = hpop.Trajectory.from_poses(problem.model, [(x + 0.0043 * k, y, 0.0) for k in range(140)])
    front = hpop.Front.of([[0.0, 0.5977]], [way], names=["turns", "length"], units=["1", "m"])
    trace = Page(payload(problem, front)).traces[0]
    speed = trace["each"]["length"][1] / np.diff(trace["t"])  # m/s; a millisecond is a quarter of a piece
    assert len(speed) == 139
    assert speed == pytest.approx(problem.model.speed, rel=0.01)


def test_of_many_rows_some_are_traced_the_named_ones_among_them():
    problem, front = seeded(60)
    rows = [trace["row"] for trace in payload(problem, front)["traces"]]
    assert 6 < len(rows) == len(set(rows)) <= 10
    assert {point.index for point in front.named().values()} <= set(rows)


def test_the_world_is_drawn_whole(make_front):
    ring = shapely.box(1, 1, 3, 3).difference(shapely.box(1.5, 1.5, 2.5, 2.5))
    world = hpop.World.from_polygons(
        [ring, (shapely.box(5, 5, 6, 6), (0.5, 2.0))],
        extent=shapely.box(0, 0, 10, 8).difference(shapely.box(8, 0, 9, 1)),
        keep_out=shapely.MultiPolygon([shapely.box(0, 7, 1, 8), shapely.box(3, 7, 4, 8)]),
    ).with_content(
        people=[Person(7, 7, 1.0, (0.5, 0), name=ODD), Person(6, 7)],
        groups=[(0, 1)],
        landmarks=[Landmark(2, 5, facing=0.5, name="Venus")],
        zones=[
            Zone("speed", shapely.box(4, 0, 5, 1), limit=0.5, name="slow"),
            Zone("one-way", shapely.box(6, 0, 7, 2), path=shapely.LineString([(6.5, 0), (6.5, 2)])),
        ],
    )
    problem = hpop.Problem(world, hpop.DifferentialDrive(), (4, 4, 0), (7, 3, None), ["turns", "length"])
    page = Page(payload(problem, make_front(problem)))
    drawn = page.raw["world"]
    assert page.area(drawn["extent"]).equals(world.extent)
    assert page.area(drawn["closed"]).equals(world.keep_out)
    for one, obstacle in zip(drawn["obstacles"], world.obstacles, strict=True):
        assert page.area(one).equals(obstacle.polygon)
        assert one["z"] == [None if np.isinf(z) else z for z in obstacle.heights]
    assert [page.area(zone["area"]).equals(z.area) for zone, z in zip(drawn["zones"], world.content.zones, strict=True)]
    assert drawn["zones"][1]["path"] == [6.5, 0, 6.5, 2]
    person, _ = drawn["people"]
    assert (person["x"], person["y"], person["yaw"], person["velocity"]) == (7, 7, 1.0, [0.5, 0])
    assert not set(person["name"]) & {"\N{RIGHT-TO-LEFT OVERRIDE}", "\x1b"}
    assert (drawn["groups"], drawn["landmarks"][0]["name"]) == ([[0, 1]], "Venus")
    assert (drawn["start"], drawn["goals"]) == ({"x": 4, "y": 4, "yaw": 0}, [{"x": 7, "y": 3, "yaw": None}])


def test_cells_are_drawn_as_the_areas_that_they_fill(make_front):
    cells = np.random.default_rng(3).random((40, 60)) < 0.3
    cells[:12, :12] = False
    world = hpop.World.from_cells(cells, 0.2, origin=(-3.0, 5.0, 0.3))
    x, y = world.raster.to_world(np.array([4.0, 9.0]), np.array([4.0, 9.0]))
    ends = [(float(x[i]), float(y[i]), 0.0) for i in range(2)]
    problem = hpop.Problem(world, hpop.DifferentialDrive(radius=0.1), *ends, ["turns", "length"])
    page = Page(payload(problem, make_front(problem)))
    (drawn,) = page.raw["world"]["obstacles"]
    rows, columns = np.nonzero(cells | True)
    middles = np.stack(world.raster.to_world(columns + 0.5, rows + 0.5), axis=1)
    area = page.area(drawn)
    assert (shapely.contains_xy(area, middles) == cells.ravel()).all()
    assert area.area == pytest.approx(cells.sum() * 0.04, rel=1e-3)


def test_the_measured_field_of_a_criterion_is_on_a_grid_with_its_range_in_free_space(make_front):
    samples = np.random.default_rng(4).uniform(-80, -40, (5, 9))
    wifi = MeasuredField(samples, 1.0, (-0.5, -0.5, 0.0), name="wifi", unit="dBm", outside=-90.0)
    world = hpop.World.from_polygons([], extent=shapely.box(0, 0, 8, 4)).with_fields([wifi])
    criteria = ["length", "turns", {"field_exposure": {"field": "wifi", "good": -55.0, "bad": -70.0}}]
    for chosen in (criteria, criteria[:2]):
        problem = hpop.Problem(world, hpop.DifferentialDrive(radius=0.1), (1, 1, 0), (7, 3, 0), chosen)
        page = Page(payload(problem, make_front(problem)))
        found = page.raw["world"]["field"]
        assert (found is None) == (chosen != criteria)
        if found is None:
            continue
        assert (found["name"], found["unit"]) == ("wifi", "dBm")
        shares = page.numbers(found["values"]).reshape(-1, found["width"]) / 1000
        x0, y0, x1, y1 = found["box"]
        height, width = shares.shape
        x, y = np.meshgrid(x0 + (x1 - x0) * (np.arange(width) + 0.5) / width,
                           y0 + (y1 - y0) * (np.arange(height) + 0.5) / height)  # fmt: skip
        told = found["low"] + shares * (found["high"] - found["low"])
        truth = wifi(x.ravel(), y.ravel()).reshape(shares.shape)
        free = (x > 0) & (x < 8) & (y > 0) & (y < 4)
        assert np.abs(told - truth)[free].max() <= 0.0006 * (found["high"] - found["low"])
        assert (found["low"], found["high"]) == (truth[free].min(), truth[free].max())


def test_cells_too_ragged_to_be_outlined_are_taken_together_and_a_note_says_so(make_front, monkeypatch):
    from hpop.view import explorer as drawn

    monkeypatch.setattr(drawn, "MOST_CORNERS", 300)
    cells = np.random.default_rng(3).random((40, 60)) < 0.2
    cells[:8, :8] = False
    plain = hpop.World.from_cells(cells, 0.5)
    coloured = replace(plain.raster, contrasts=np.full(cells.shape, 50, dtype=np.uint8))  # as of a coloured image
    world = replace(plain, ground=replace(plain.ground, raster=coloured))
    problem = hpop.Problem(world, hpop.DifferentialDrive(radius=0.1), (1, 1, 0), (3, 3, 0), ["turns", "length"])
    page = Page(payload(problem, make_front(problem)))
    (area,) = (page.area(one) for one in page.raw["world"]["obstacles"])
    rows, columns = np.nonzero(cells)
    assert shapely.contains_xy(area, 0.5 * columns + 0.25, 0.5 * rows + 0.25).all()
    assert sum(map(len, page.rings)) <= 300 + 8
    assert any("is drawn in cells of" in note for note in page.raw["notes"])


@pytest.mark.parametrize("shift", [0.0, 5e6])
def test_a_map_of_5_km_far_from_its_origin_is_told_to_the_millimetre(make_front, shift):
    extent = shapely.box(shift, shift, shift + 5000, shift + 5000)
    house = shapely.box(shift + 1234.567, shift + 2000, shift + 1300, shift + 2100.125)
    world = hpop.World.from_polygons([house], extent=extent)
    ends = [(shift + 0.5 + 0.001, shift + 4999.5, 0.0), (shift + 4999.123, shift + 1.0, None)]
    problem = hpop.Problem(world, hpop.DifferentialDrive(), *ends, ["turns", "length"])
    way = hpop.Trajectory.from_poses(problem.model, [ends[0], (*ends[1][:2], 0.0)])
    page = Page(payload(problem, of([way], problem)))
    assert np.abs(page.path(0) - [ends[0][:2], ends[1][:2]]).max() < 6e-4
    (drawn,) = page.raw["world"]["obstacles"]
    assert np.abs(np.array(page.area(drawn).bounds) - house.bounds).max() < 6e-4


@pytest.mark.parametrize("rows", [0, 1])
def test_fronts_of_none_and_of_one(problem, make_front, rows):
    costs = np.array([[1.0, 2, 3, 4, 5]])[:rows]
    front = make_front(problem, costs=costs, status="complete" if rows else "no path")
    page = Page(payload(problem, front))
    assert page.raw["count"] == len(page.counts) == rows == len(page.raw["marks"])
    assert all(len(values) == rows for values in page.columns.values())
    assert page.raw["title"].startswith("Trade-offs" if rows else "No path")
    assert page.raw["complete"] is bool(rows)


def test_columns_that_are_equal_and_a_start_that_is_the_goal(make_problem, make_front):
    problem = make_problem(goal=(1, 1, 0))
    stays = hpop.Trajectory.from_poses(problem.model, [(1, 1, 0)])
    page = Page(payload(problem, replace(of([stays], problem), reported=np.zeros((1, 0)))))
    assert (page.path(0).tolist(), page.traces) == ([[1, 1]], {})
    equal = make_front(make_problem(["turns", "length"]), costs=np.array([[3.0, 5.0]]))
    assert payload(make_problem(["turns", "length"]), equal)["count"] == 1


@pytest.mark.parametrize(
    ("rows", "most"),
    [
        (158, 100_000),
        pytest.param(3290, 800_000, marks=pytest.mark.proof),
        pytest.param(8000, 2_000_000, marks=pytest.mark.proof),
    ],
)
def test_a_page_is_small(rows, most):
    assert len(single_page("explorer.js", "title", payload(*seeded(rows))).encode()) <= most
