"""Pictures and exports of a tour: each visit has the name of its stop, at the times of the motion that is shown."""

from __future__ import annotations

import json

import numpy as np
import pytest

import hpop
from hpop.export import save
from hpop.problems.named_rows import stop_visits, visit_order
from hpop.view import draw_map, draw_trace, draw_where
from hpop.view.look import look
from hpop.view.marks import holds_of, is_held, written_time
from hpop.world.content.content import Landmark
from tests.tours import STOPS, tour_front, tour_problem


@pytest.fixture(scope="module")
def problem():
    return tour_problem()


@pytest.fixture(scope="module")
def front(problem):
    return tour_front(problem)


def test_a_trace_names_each_visit_in_the_middle_of_its_dwell(problem, front):
    row = next(row for row in range(len(front)) if len(visit_order(front, row).split()) == 4)
    axes = draw_trace(problem, front.trajectories[row]).axes[-2]
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
    texts = [text.get_text() for text in draw_trace(named, front.trajectories[0]).axes[-2].texts]
    assert {"1 the cabine…", "2 north"} <= set(texts)
    plain = hpop.Problem(problem.world, problem.model, problem.start, (2, 4, None), ["turns"])
    texts = draw_trace(plain, front.trajectories[0]).axes[-2].texts
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


def drawn_map(problem, front, rows):
    """Return the axes of a map with some rows, and its clocks: lines with the labels of their tours as gid."""
    figure = draw_map(problem, front, chosen={f"tour {row}": row for row in rows})
    figure.canvas.draw()
    axes = next(axes for axes in figure.axes if axes.get_label() == "map")
    return axes, [line for line in axes.lines if str(line.get_gid()).startswith("holds of ")]


def test_clocks_of_several_tours_cover_neither_each_other_nor_the_numbers_of_stops(problem, front):
    axes, clocks = drawn_map(problem, front, np.linspace(0, len(front) - 1, 6).astype(int).tolist())
    places = np.array([line.get_transform().transform(line.get_xydata())[0] for line in clocks])
    stops = axes.transData.transform([stop.get("at", (6.5, 5.5)) for stop in STOPS])
    point = axes.get_figure().dpi / 72
    apart = np.abs(places[:, None] - np.concatenate([places, stops])) / point
    close = (apart[..., 0] < 40.0) & (apart[..., 1] < 12.0)
    assert len(clocks) >= 3
    assert close.sum() == len(clocks)  # each is close to itself alone


def test_tours_that_stand_together_for_one_time_share_a_clock(problem, front):
    rows = np.linspace(0, len(front) - 1, 6).astype(int).tolist()
    axes, clocks = drawn_map(problem, front, rows)
    holds = [(f"tour {row}", held) for row in rows for held in holds_of(front.trajectories[row])]
    owners = [str(line.get_gid()).removeprefix("holds of ").split(", ") for line in clocks]
    assert sorted(label for labels in owners for label in labels) == sorted(label for label, _ in holds)
    tips = {text.xy for text in axes.texts if getattr(text, "arrow_patch", None) is not None}
    assert {(held.x, held.y) for _, held in holds} <= tips  # a line leads to each position
    words = {f"{stop['dwell']:g} s": stop.get("at", (6.5, 5.5)) for stop in STOPS if "dwell" in stop}
    for text, stop in words.items():  # dwells differ: a clock belongs to one stop
        near = [held for _, held in holds if written_time(held.seconds) == text]
        number = sum(t.get_text() == text for t in axes.texts)
        assert all(np.hypot(held.x - stop[0], held.y - stop[1]) <= 2.0 for held in near)
        assert 1 <= number < len(near)


def test_where_shows_the_numbers_and_discs_of_stops_in_each_map(problem, front):
    figure = draw_where(problem, front.trajectories[0])
    maps = [axes for axes in figure.axes if axes.get_xlabel() == "x (m)"]
    assert len(maps) == len(problem.criteria)
    for axes in maps:
        assert [text.get_text() for text in axes.texts if text.get_gid() == "stop"] == ["1", "2", "3", "4"]
        assert len([patch for patch in axes.patches if patch.get_gid() == "stop disc"]) == 3
    assert any("3 vase" in text.get_text() for text in figure.legends[0].get_texts())


@pytest.mark.parametrize("x", [0.4, 6.5, 7.6])
def test_the_name_of_a_landmark_lies_within_the_map(problem, x):
    marked = problem.world.with_content(landmarks=[Landmark(x, 3.2, 1.2, name="a long name")])
    plain = hpop.Problem(marked, problem.model, problem.start, (2, 4, None), ["length"])
    figure = look(plain, "map").figure
    figure.canvas.draw()
    axes = next(axes for axes in figure.axes if axes.get_label() == "look")
    (name,) = [text for text in axes.texts if text.get_text() == "a long name"]
    drawn, frame = name.get_window_extent(), axes.get_window_extent()
    assert frame.x0 <= drawn.x0
    assert drawn.x1 <= frame.x1
