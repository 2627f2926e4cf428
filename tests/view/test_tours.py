"""Pictures and exports of a tour: each visit has the name of its stop, at the times of the motion that is shown."""

from __future__ import annotations

import json

import numpy as np
import pytest

import hpop
from hpop.export import save
from hpop.problems.recorded_visits import stop_visits, visit_order
from hpop.view import draw_map, draw_trace
from hpop.view.marks import is_held
from tests.tours import STOPS, tour_front, tour_problem


@pytest.fixture(scope="module")
def problem():
    return tour_problem()


@pytest.fixture(scope="module")
def front(problem):
    return tour_front(problem)


def test_a_trace_names_each_visit_in_the_middle_of_its_dwell(problem, front):
    row = next(row for row in range(len(front)) if len(visit_order(front, row).split()) == 4)
    axes = draw_trace(problem, front.trajectories[row]).axes[0]
    texts = {text.get_text(): text.get_position()[0] for text in axes.texts if text.get_gid() == "visit"}
    assert set(texts) == {"1 east", "2 north", "3 vase", "4 passed"}
    for visit in front.provenance[row]["visits"]:
        (x,) = (x for text, x in texts.items() if text.endswith(visit["stop"]))
        assert visit["begin"] <= x <= visit["end"]
    lines = [line for line in axes.lines if line.get_gid() == "visit"]
    assert [line.get_xdata()[0] for line in lines] == [texts["4 passed"]]  # it has no dwell


def test_a_trace_of_missed_stops_begins_with_all_optional_ones_and_falls_at_each_visit(problem, front):
    row = next(row for row in range(len(front)) if len(visit_order(front, row).split()) == 4)
    axes = next(axes for axes in draw_trace(problem, front.trajectories[row]).axes if "missed" in axes.get_ylabel())
    line = max(axes.lines, key=lambda line: len(line.get_xdata()))
    times, values = line.get_xdata(), line.get_ydata()
    assert values[0] == 2
    ends = sorted(v["end"] for v in front.provenance[row]["visits"] if v["stop"] in ("vase", "passed"))
    assert times[1:][np.diff(values) < 0] == pytest.approx(ends)


def test_a_long_name_is_cut_and_a_problem_without_a_tour_has_no_names(problem, front):
    stops = [{**STOPS[0], "name": "the cabinet of curiosities"}, *STOPS[1:]]
    named = hpop.Problem(
        problem.world, problem.model, problem.start, (2, 4, None), ["turns"], tour=hpop.Tour(stops[:2], order="any")
    )
    texts = [text.get_text() for text in draw_trace(named, front.trajectories[0]).axes[0].texts]
    assert {"1 the cabine…", "2 north"} <= set(texts)
    plain = hpop.Problem(problem.world, problem.model, problem.start, (2, 4, None), ["turns"])
    texts = draw_trace(plain, front.trajectories[0]).axes[0].texts
    assert [text for text in texts if text.get_gid() == "visit"] == []


@pytest.mark.parametrize("planned", [True, False])
def test_an_export_says_when_the_robot_arrives_at_each_stop_and_leaves(problem, front, planned, tmp_path):
    rows = list(range(0, len(front), 9))
    save(problem, front, tmp_path, rows=rows, formats=["csv"], planned=planned)
    for row in rows:
        about = json.loads((tmp_path / f"row_{row}.about.json").read_text())
        assert [visit["stop"] for visit in about["visits"]] == [v["stop"] for v in front.provenance[row]["visits"]]
        run = front.trajectories[row] if planned else front.trajectories[row].execution()
        for visit in about["visits"]:
            stop = next(s for s in STOPS if s.get("name", s.get("landmark")) == visit["stop"])
            assert visit["leaving"] - visit["arrival"] == pytest.approx(stop.get("dwell", 0.0))
            states = run.at(np.linspace(visit["arrival"], visit["leaving"], 30))
            assert np.ptp(states.x) == pytest.approx(0, abs=1e-9)
            assert np.ptp(states.y) == pytest.approx(0, abs=1e-9)
            x, y = stop.get("at", (6.5, 5.5))
            assert np.hypot(states.x - x, states.y - y).max() <= stop["within"] + 1e-6


def test_visits_that_are_recorded_otherwise_are_left_out(front):
    for odd in (None, 3, [{"stop": "elsewhere", "begin": 0, "end": 1}], [{"stop": "east"}], ["east"]):
        changed = hpop.Front.of(
            front.costs[:1],
            front.trajectories[:1],
            names=front.names,
            units=front.units,
            quanta=front.quanta,
            groups=front.groups,
            status="complete",
            certificate="exact",
            provenance=[{"visits": odd}],
            problem=front.problem,
        )
        assert stop_visits(changed, 0) == []
        assert visit_order(changed, 0) == "-"


def test_a_map_shows_what_the_camera_sees_at_each_stop_with_a_dwell(problem, front):
    row = next(row for row in range(len(front)) if len(visit_order(front, row).split()) == 4)
    axes = next(axes for axes in draw_map(problem, front, chosen={"all": row}).axes if axes.get_label() == "map")
    (views,) = [artist for artist in axes.collections if artist.get_gid() == "views of all"]
    tour = front.trajectories[row]
    states = tour.at(tour.times[:-1][is_held(tour)])
    assert len(views.get_paths()) == states.size == 3  # "passed" has no dwell
    for path, x, y, yaw in zip(views.get_paths(), states.x, states.y, states.yaw, strict=True):
        assert np.hypot(*(path.vertices - (x, y)).T).min() == pytest.approx(0.0, abs=1e-9)
        assert (path.vertices.mean(axis=0) - (x, y)) @ (np.cos(yaw), np.sin(yaw)) > 0.0


def test_clocks_of_several_tours_cover_neither_each_other_nor_the_numbers_of_stops(problem, front):
    rows = np.linspace(0, len(front) - 1, 6).astype(int)
    figure = draw_map(problem, front, chosen={f"tour {row}": int(row) for row in rows})
    figure.canvas.draw()
    axes = next(axes for axes in figure.axes if axes.get_label() == "map")
    gids = [f"holds of tour {row}" for row in rows]
    clocks = [line for line in axes.lines if line.get_gid() in gids]
    places = np.array([line.get_transform().transform(line.get_xydata())[0] for line in clocks])
    stops = axes.transData.transform([stop.get("at", (6.5, 5.5)) for stop in STOPS])
    point = figure.dpi / 72
    apart = np.abs(places[:, None] - np.concatenate([places, stops])) / point
    close = (apart[..., 0] < 40.0) & (apart[..., 1] < 12.0)
    assert len(clocks) > 12
    assert close.sum() == len(clocks)  # each is close to itself alone
