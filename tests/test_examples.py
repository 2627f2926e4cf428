"""The examples run, and show what they say; the longest of them in the proof, and as they are for the site."""

from __future__ import annotations

import importlib.util
import math
import re
import runpy
import sys
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner

import hpop
from hpop.cli import main
from hpop.cli.beside import PicturesBeside
from hpop.frontier import is_nondominated
from hpop.goals import LookAt
from hpop.planners.graph_planners import Lattice
from hpop.problems.verify import verify
from hpop.scenario import load_scenario
from hpop.view import draw_map, draw_side, save_pictures

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "examples"
pytestmark = pytest.mark.usefixtures("registered_as_before")


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw the pictures with fewer pixels."""
    monkeypatch.setattr("hpop.view.save_pictures", partial(save_pictures, dpi=40))


def example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location("example_" + Path(name).stem, EXAMPLES / name)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # pickling a criterion needs an importable module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["02_ros_map.py", "11_wifi_survey.py", "field_museum.py"])
@pytest.mark.parametrize("arguments", [[], ["--help"]])
def test_an_example_that_needs_data_says_how_it_is_run(warm, tmp_path, name, arguments):
    code = f"import runpy, sys; sys.argv[0] = {name!r}; runpy.run_path({str(EXAMPLES / name)!r}, run_name='__main__')"
    done = warm.run(*arguments, cwd=tmp_path, code=code)
    assert done.returncode == 1
    assert f"python examples/{name} " in done.stderr
    assert "Traceback" not in done.stderr


@pytest.fixture
def map_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """One of the pictures; the others take as long as all the planning."""
    monkeypatch.setattr("hpop.view.save_pictures", partial(save_pictures, dpi=40, map_alone=True))


@pytest.mark.proof
@pytest.mark.usefixtures("map_alone")
def test_the_museum_tour_has_a_complete_front_and_its_picture(tmp_path):
    """All four are drawn of the same front by docs/first_plan.md (`test_docs.py`)."""
    front = example("01_museum.py").main(tmp_path)
    assert front.status == "complete"
    assert {path.name for path in tmp_path.iterdir()} == {"front.json", "map.png"}


@pytest.mark.proof
@pytest.mark.usefixtures("map_alone")
def test_a_survey_of_wifi_is_told_where_it_ends_and_trades_against_length(tmp_path, shared_data, capsys):
    office = shared_data("pal_office") / "map.yaml"
    front = example("11_wifi_survey.py").main(office, (6.0, -8.0), (-10.0, 1.0), folder=tmp_path)
    assert front.status == "complete"
    told = re.search(r"field 'wifi' was measured in ([0-9.]+) % of the free space; elsewhere it counts as -85 dBm",
                     capsys.readouterr().out)  # fmt: skip
    assert told is not None
    assert 50.0 < float(told[1]) < 100.0
    assert front.costs[:, 0].min() < 0.8 * front.costs[np.argmin(front.costs[:, 2]), 0]


@pytest.mark.proof
def test_a_gentle_ride_costs_time_and_saves_most_of_the_dose(tmp_path):
    front = example("12_passenger.py").main(tmp_path, points=2)
    (fast, most), (slow, least) = front.costs
    assert slow == pytest.approx(2 * fast, rel=1e-2)
    assert least < 0.2 * most
    assert {path.name for path in tmp_path.iterdir()} == {"front.json", "map.png", "front.png", "felt.png"}


@pytest.mark.usefixtures("map_alone")
def test_a_ros_map_is_planned_with_any_heading_at_the_goal(tmp_path, shared_data):
    main = example("02_ros_map.py").main
    front = main(shared_data("pal_office") / "map.yaml", (-2.0, 0.0), (2.0, 1.0), tmp_path)
    assert len(front) > 0
    assert "optimal for it as well" in front.certificate


def test_ones_own_criterion_is_planned_with(capsys):
    front = example("03_own_criterion.py").main()
    assert front.names == ("glare", "turns", "length")
    # The shortest path heads straight into the sun for 26 s: cos(0)^4 = 1.
    shortest = front.best("length")
    assert shortest.costs["glare"] == pytest.approx(26.0, abs=1e-3)
    assert front.best("glare").costs["glare"] < 26.0


def test_ones_own_criterion_of_the_camera_serves_a_head_as_it_is():
    """The base drives into the sun all the same, and the head looks aside: what it costs is to pan."""
    world = hpop.World.from_geojson(EXAMPLES / "museum.geojson")
    glare, head = example("03_own_criterion.py").Glare(), hpop.PanTilt(tilt=(0.0, 0.0))
    start, goal = (2.0, 10.0, 0.0, 0.0, 0.0), (28.0, 10.0, 0.0, None, 0.0)
    front = hpop.Problem(world, head, start, goal, [glare, "rotation", "length"]).solve("lattice", step=2.0, headings=4)
    still, aside = front.best("rotation"), front.best("glare")
    assert still.costs == pytest.approx({"glare": 26.0, "rotation": 0.0, "length": 26.0})
    assert aside.costs["length"] == pytest.approx(26.0)
    assert aside.costs["glare"] < 3.0
    assert aside.item.kinds.count("pan") == 1


@pytest.mark.proof
def test_the_studys_trajectories_differ_as_in_the_paper(tmp_path, monkeypatch, capsys):
    """The shortest is shorter and turns more than that of least turns; the RRT's turns more than both.

    Of its people the identities of Kruskal-Wallis and Dunn are printed, and the report says that it has no answers.
    """
    monkeypatch.setattr("hpop.study.report.DPI", 30)
    trajectories = example("04_study.py").main(tmp_path, runs=2, step=1.0)
    states = {name: trajectory.states for name, trajectory in trajectories.items()}
    length = {name: np.hypot(np.diff(s.x), np.diff(s.y)).sum() for name, s in states.items()}
    turns = {name: int((np.abs(np.diff(s.yaw)) > 0.1).sum()) for name, s in states.items() if name != "RRT"}
    assert turns["least turns"] < turns["shortest"]
    assert length["shortest"] < min(length["least turns"], length["RRT"])
    heading = np.sign(np.diff(states["RRT"].yaw))
    assert (np.diff(heading) != 0).sum() > turns["shortest"]
    assert (tmp_path / "study.png").stat().st_size > 10_000
    printed = capsys.readouterr().out.splitlines()
    assert "SIMULATED" in (tmp_path / "report" / "report.html").read_text()
    assert sum("SIMULATED" in line for line in printed) == 1
    found = {line.split("  ")[0]: re.findall(r"-?[0-9.]+", line[19:]) for line in printed[-3:]}
    assert found["Kruskal-Wallis"][0] == found["2/3 sum of z^2"][0]
    assert found["z12 + z23, z13"] == [found["z12 + z23, z13"][0]] * 2 + ["2.998", "3.004"]
    assert found["2/3 sum of z^2"][1] == "9.056"


@pytest.mark.proof
def test_a_head_that_turns_back_trades_rotation_for_looking_where_one_drives(tmp_path, monkeypatch):
    def save_map(problem, front, folder):
        """One of its pictures; the others take as long as all the planning."""
        figure = draw_map(problem, front)
        assert any(str(artist.get_gid()).startswith("views of") for artist in figure.findobj())
        figure.savefig(folder / "map.png", dpi=40)

    monkeypatch.setattr("hpop.view.save_pictures", save_map)
    front = example("05_pan_tilt.py").main(tmp_path, step=3.0)
    still, ahead = front.best("rotation"), front.best("heading_mismatch")
    assert "unwind" in still.item.kinds
    assert "pan" in front.best("landmark_blindness").item.kinds
    assert still.costs["rotation"] < ahead.costs["rotation"]
    assert still.costs["heading_mismatch"] > ahead.costs["heading_mismatch"] == pytest.approx(0.0)
    saved = hpop.Front.load(tmp_path / "front.json")
    assert isinstance(saved.trajectories[0].model, hpop.PanTilt)
    np.testing.assert_array_equal(saved.costs, front.costs)


@pytest.mark.proof
def test_a_base_drives_an_arm_to_a_shelf_in_several_ways(tmp_path, monkeypatch, capsys):
    def save_map(problem, front, folder):
        """One of its pictures."""
        draw_map(problem, front).savefig(folder / "map.png", dpi=40)

    monkeypatch.setattr("hpop.view.save_pictures", save_map)
    front = example("07_mobile_arm.py").main(tmp_path, samples=100)
    assert "; 0 drives" not in capsys.readouterr().out
    assert len(front) > 1
    model = front.trajectories[0].model
    assert load_scenario(EXAMPLES / "mobile_arm.yaml").problem.model == model
    for trajectory in front.trajectories:  # the base stands, in front of the shelf, while the arm reaches to the can
        assert {"run", "reach"} <= set(trajectory.kinds)
        end, camera = trajectory.states.take([-1]), model.pose("camera", trajectory.states.take([-1]))
        assert 3.0 < end.x[0] < 4.55
        apart = np.linalg.norm([camera.x[0] - 4.75, camera.y[0] - 2.5, camera.z[0] - 0.82])
        assert apart == pytest.approx(0.3, abs=0.1 + 1e-6)


def test_the_studys_picture_says_what_each_line_is(tmp_path):
    study = example("04_study.py")
    problem = hpop.Problem(
        hpop.World.from_geojson(EXAMPLES / "museum.geojson"), hpop.DifferentialDrive(), (2, 10, 0), (28, 17, 0),
        ["obstruction", "turns", "length", "curvature_sign_changes"],
    )  # fmt: skip
    way = hpop.Trajectory.from_poses(problem.model, [problem.start, problem.goal])
    figure = study.draw(problem, dict.fromkeys(study.LINES, way), dict.fromkeys(study.LINES, problem.evaluate(way)))
    figure.savefig(tmp_path / "study.png")
    (legend,) = figure.legends
    of = [text.get_text().split(":")[0] for text in legend.get_texts()]
    lattice = [f"{name} on the 0.5 m lattice" for name in ("least turns", "shortest")]
    assert of == ["obstacle", *lattice, "RRT run with the fewest sign changes"]
    assert len({str(handle.get_linestyle()) for handle in legend.legend_handles[1:]}) == 3  # apart without colour
    for box in (legend.get_window_extent(), figure.axes[0].title.get_window_extent()):
        assert 0 <= box.y0 < box.y1 <= figure.bbox.y1
        assert 0 <= box.x0 < box.x1 <= figure.bbox.x1


@pytest.mark.proof
def test_the_papers_structure_is_reproduced(tmp_path):
    """One optimum with V = 0 and N = 8; one with N = 0 that is the shortest; others between."""
    front = example("paper_figure/paper_figure.py").main(tmp_path)
    clear, straight = front.lexicographic(["exposure", "turns"]), front.best("turns")
    assert clear.reported["obstruction"] == 0.0
    assert clear.costs["turns"] == 8
    assert straight.costs["turns"] == 0
    assert straight.index == front.best("length").index
    assert straight.costs["length"] == pytest.approx(19.75 - 4.0)
    between = (front.costs[:, 1] > 0) & (front.costs[:, 0] > 0) & (front.costs[:, 2] < clear.costs["length"])
    assert between.any()


def test_no_path_of_the_papers_figure_keeps_everything_clear_with_fewer_turns():
    """V = 0 is impossible with seven turns: a second search, on turns and exposure alone, agrees."""
    museum = example("paper_figure/paper_figure.py").museum
    problem = hpop.Problem(
        museum(), hpop.DifferentialDrive(), (4.0, 10.0, 0.0), (19.75, 10.0, 0.0), ["exposure", "turns"]
    )
    front = problem.solve(Lattice(step=0.25))
    fewer = front.costs[front.costs[:, 1] < 8]
    assert np.all(fewer[:, 0] > 0)


# An arm with a camera in its hand


@pytest.fixture
def no_pictures(monkeypatch):
    """Each takes a second or more."""
    monkeypatch.setattr("hpop.view.save_pictures", lambda problem, front, folder, **options: [])
    monkeypatch.setattr(PicturesBeside, "_begin", lambda pictures, which: None)


def assert_looked_at(problem: hpop.Problem, front: hpop.Front) -> None:
    """All trajectories end with the target in the middle of the view, within the band, the picture upright."""
    goal = problem.target
    assert isinstance(goal, LookAt)
    ends = [trajectory.states.take([-1]) for trajectory in front.trajectories]
    for pose in (problem.model.pose("camera", end) for end in ends):
        way = np.array(goal.target) - [pose.x[0], pose.y[0], pose.z[0]]
        ahead = np.array([column[0] for column in pose.ahead])
        assert goal.distance[0] - 1e-6 <= np.linalg.norm(way) <= goal.distance[1] + 1e-6
        assert ahead @ way / np.linalg.norm(way) >= math.cos(math.radians(1.0)) - 1e-9
        assert abs(pose.roll[0]) <= math.radians(1.0) + 1e-9


def test_many_queries_on_one_map_are_answered(capsys):
    fronts = example("08_many_queries.py").main(step=1.0, queries=4)
    assert [front.status for front in fronts] == ["complete"] * 4
    assert "4 queries, " in capsys.readouterr().out


def test_the_loop_of_a_robot_node_plans_on_a_changing_grid(capsys):
    fronts = example("08_many_queries.py").loop(step=1.0, queries=4)
    assert [front.status for front in fronts] == ["complete"] * 4
    assert all("edges_rechecked" in front.runs[0] for front in fronts[1:])
    assert "4 queries on a changing grid" in capsys.readouterr().out


def test_a_batch_compares_planners_on_the_same_problems(tmp_path, capsys):
    results = example("09_batch.py").main(str(tmp_path / "batch"), floors=1, pairs=2, workers=1)
    assert len(set(results.table(["id"])["id"].to_pylist())) == 6
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == [
        "planner",
        "lattice,",
        "lattice,",
        "roadmap",
    ]
    assert (tmp_path / "batch" / "summary.png").stat().st_size > 1000


@pytest.mark.proof
def test_each_guided_tour_stands_ten_seconds_with_each_of_its_exhibits_in_view(tmp_path, capsys):
    guided = example("10_guided_tour.py")
    front = guided.main(tmp_path, step=1.0)
    assert front.status == "complete"
    assert is_nondominated(front.costs).all()
    orders = set()
    for point, origin in zip(front, front.provenance, strict=True):
        order = tuple(visit["stop"] for visit in origin["visits"])
        assert set(guided.EXHIBITS) - set(guided.OPTIONAL) <= set(order) <= set(guided.EXHIBITS)
        assert point.costs["stops_missed"] == 4 - len(order) == 4 - len(set(order))
        for visit in origin["visits"]:
            states = point.item.at(np.linspace(visit["begin"], visit["end"], 5))
            x, y, _ = guided.EXHIBITS[visit["stop"]]
            assert visit["end"] - visit["begin"] == pytest.approx(10.0)
            assert np.hypot(x - states.x, y - states.y).max() <= 3.0
            off = np.arctan2(y - states.y, x - states.x) - states.yaw
            assert (np.cos(off) >= math.cos(math.radians(30.0)) - 1e-9).all()
        orders.add(order)
    assert {len(order) for order in orders} == {2, 3, 4}
    driven = {speed for trajectory in front.trajectories for speed in trajectory.states.speed.tolist()}
    assert driven == {0.0, 0.5, 1.0, 1.5}
    printed = capsys.readouterr().out
    assert printed.count("dinosaur, ") > 12  # in the certificate, and in each of twelve rows
    assert {path.name for path in tmp_path.iterdir()} == {"front.json", "map.png", "front.png", "trace.png"}


@pytest.mark.proof
def test_a_drive_is_chosen_anew_after_each_event_and_arrives(tmp_path, capsys):
    plan = example("07_drive.py").main(tmp_path, step=1.0)
    printed = capsys.readouterr().out
    assert "stop: Ada" in printed
    assert (plan.states.x[-1], plan.states.y[-1]) == pytest.approx((28.0, 10.0))
    through = (plan.states.x > 13.9) & (plan.states.x < 15.1)
    assert not ((plan.states.y[through] > 9.0) & (plan.states.y[through] < 11.0)).any()  # where it is closed
    assert hpop.drive.load(tmp_path / "drive.json").plan.duration == pytest.approx(plan.duration)
    assert {path.name for path in tmp_path.iterdir()} == {"drive.json", "drive.png", "plan.png"}


@pytest.mark.proof
def test_an_arm_looks_at_each_can_for_two_seconds_in_several_orders(tmp_path, monkeypatch, capsys):
    drawn = []

    def save_side(problem, front, folder):
        """Draw the picture that only arms have; the others take as long as all the planning."""
        artists = draw_side(problem, front).findobj()
        assert any(str(artist.get_gid()).startswith("views of") for artist in artists)
        assert [artist.get_text() for artist in artists if artist.get_gid() == "stop"] == ["1", "2", "3"]
        assert verify(problem, front) == []
        drawn.append(front)

    monkeypatch.setattr("hpop.view.save_pictures", save_side)
    arms = example("06_arm.py")
    front = arms.main(tmp_path, samples=60)
    assert drawn == [front]
    said = re.findall(
        r"rotation of the fastest tour: (\S+) rad, with an unwound view (\S+) rad", capsys.readouterr().out
    )
    rotation = front.named()["least duration"].costs["rotation"]
    assert [float(number) for number in said[0]] == [pytest.approx(rotation, abs=0.01), 0.0]
    assert is_nondominated(front.costs).all()
    assert len({tuple(visit["stop"] for visit in origin["visits"]) for origin in front.provenance}) > 1
    for trajectory, origin in zip(front.trajectories, front.provenance, strict=True):
        assert_cans_seen(arms.CANS, trajectory, origin["visits"])


@pytest.mark.proof
def test_two_arms_plan_a_view_of_the_work(tmp_path, monkeypatch):
    """The pictures take as long as all the planning, so only the side view is drawn."""
    drawn = []

    def save_side(problem, front, folder):
        draw_side(problem, front)
        assert verify(problem, front) == []
        drawn.append(front)

    monkeypatch.setattr("hpop.view.save_pictures", save_side)
    front = example("06_two_arms.py").main(tmp_path, samples=40)
    assert drawn == [front]
    assert len(front) > 3
    assert len({trajectory.duration for trajectory in front.trajectories}) == 1
    looks = front.costs[:, front.names.index("look_at")]
    assert looks.min() < 0.5 * looks.max()


def assert_cans_seen(cans, trajectory, visits):
    """Check, by the camera's pose alone, that it stands for two seconds and looks at each can upright from near."""
    assert sorted(visit["stop"] for visit in visits) == sorted(f"can {name}" for name in cans)
    for visit in visits:
        assert visit["end"] - visit["begin"] == pytest.approx(2.0)
        pose = trajectory.model.pose("camera", trajectory.at(np.linspace(visit["begin"], visit["end"], 9)))
        way = np.array(cans[visit["stop"].removeprefix("can ")])[:, None] - np.array([pose.x, pose.y, pose.z])
        distance = np.linalg.norm(way, axis=0)
        assert np.ptp(way, axis=1) == pytest.approx([0, 0, 0], abs=1e-9)
        assert (distance >= 0.15 - 1e-6).all()
        assert (distance <= 0.3 + 1e-6).all()
        assert ((np.array(pose.ahead) * way).sum(axis=0) / distance >= math.cos(math.radians(1.0)) - 1e-9).all()
        assert np.abs(pose.roll).max() <= math.radians(1.0) + 1e-9


@pytest.mark.usefixtures("no_pictures")
def test_an_arm_before_a_shelf_is_planned_and_shown_from_the_command_line(tmp_path):
    scenario, folder = tmp_path / "shelf.yaml", tmp_path / "out"
    text = (EXAMPLES / "arm_shelf.yaml").read_text().replace("arm/arm6", str(EXAMPLES / "arm/arm6"))
    before, _, planner = text.partition("planner:")
    assert "spline: {warm_start: {roadmap: {samples: 600}}}" in planner
    scenario.write_text(before + "planner: {roadmap: {samples: 200}}\n")
    planned = CliRunner().invoke(main, ["plan", str(scenario), "--out", str(folder)])
    assert planned.exit_code == 0, planned.output
    assert "look_at" in planned.output
    shown = CliRunner().invoke(main, ["show", str(folder)])
    assert shown.exit_code == 0, shown.output
    assert "verified" in shown.output
    front = hpop.Front.load(folder / "front.json")
    assert len(front) > 3
    assert is_nondominated(front.costs).all()
    assert_looked_at(hpop.Problem.from_description(front.problem), front)


@pytest.mark.proof
@pytest.mark.usefixtures("no_pictures")
def test_a_panda_reaches_into_a_bookshelf(tmp_path, shared_data):
    data = shared_data("mbm_panda")
    panda = example("06_panda.py")
    assert data == panda.DATA
    try:
        panda.panda_urdf()
    except FileNotFoundError as reason:
        pytest.skip(str(reason))
    front = panda.main(tmp_path, planner={"roadmap": {"samples": 50}})
    assert front.names == ("duration", "rotation", "look_at")
    assert is_nondominated(front.costs).all()
    again = hpop.Front.load(tmp_path / "front.json")
    assert verify(hpop.Problem.from_description(again.problem), again) == []


def test_the_panda_without_its_data_says_what_is_missing(tmp_path, monkeypatch):
    monkeypatch.setenv("HPOP_DATA", str(tmp_path))
    with pytest.raises(SystemExit, match=r"no folder .* set HPOP_DATA to the folder that has mbm_panda in it"):
        runpy.run_path(str(EXAMPLES / "06_panda.py"), run_name="__main__")
    monkeypatch.setattr("importlib.metadata.files", lambda name: None)
    with pytest.raises(FileNotFoundError, match="pip install example-robot-data trimesh"):
        example("06_panda.py").panda_urdf()
