"""The benchmark of the lattice search: counts of labels guard it, and they are those of the committed reference."""

from __future__ import annotations

import importlib
import json
import math
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from hpop.world import Track
from tests.search.timed.enumeration import front_by_enumeration
from tests.search.timed.instances import timed_query

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
ROW = {"instance": "m7", "step": 0.25, "eps": 0.0, "edges": 40, "front": 3}
OLD = {"labels_generated": 1000, "labels_expanded": 500, "front": 3, "edges": 40}


@pytest.fixture
def module(monkeypatch):
    """Import a file of benchmarks/, where they import each other."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))

    def load(name: str) -> ModuleType:
        return importlib.import_module(name)

    return load


@pytest.fixture
def label_counts(module) -> ModuleType:
    return module("label_counts")


def test_up_to_a_fifth_more_labels_pass(label_counts):
    row = {**ROW, "labels_generated": 1200, "labels_expanded": 600}
    assert label_counts.regressions([row], {"m7 at 0.25 m": OLD}) == []


@pytest.mark.parametrize("name", ["labels_generated", "labels_expanded"])
def test_more_than_that_names_the_instance_and_both_counts(label_counts, name):
    row = {**ROW, **OLD, name: int(1.2 * OLD[name]) + 1}
    (message,) = label_counts.regressions([row], {"m7 at 0.25 m": OLD})
    for told in ("m7 at 0.25 m", name.replace("_", " "), f"{OLD[name]} -> {row[name]}", "+20%"):
        assert told in message


def test_an_approximation_has_counts_of_its_own(label_counts):
    near = {**ROW, "eps": 0.01, "labels_generated": 1000, "labels_expanded": 500}
    few = {**OLD, "labels_generated": 100, "labels_expanded": 50}
    reference = {"m7 at 0.25 m": OLD, "m7 at 0.25 m, eps 0.01": few}
    assert [m.partition(":")[0] for m in label_counts.regressions([near], reference)] == ["m7 at 0.25 m, eps 0.01"] * 2


def test_what_has_no_reference_is_no_regression(label_counts):
    assert label_counts.regressions([{**ROW, **OLD}], {}) == []


def test_written_counts_are_read_again_and_others_stay(label_counts, tmp_path):
    file = tmp_path / "counts.json"
    label_counts.write([{**ROW, **OLD}, {**ROW, **OLD, "instance": "m9"}], file)
    label_counts.write([{**ROW, **OLD, "labels_generated": 7}], file)
    assert label_counts.read(file) == {"m7 at 0.25 m": {**OLD, "labels_generated": 7}, "m9 at 0.25 m": OLD}


def test_make_bench_fails_on_a_regression_and_still_writes_what_it_measured(
    module, label_counts, monkeypatch, tmp_path
):
    lattice, out = module("lattice"), tmp_path / "bench" / "lattice.json"
    worse = {**ROW, **OLD, "labels_generated": 1300}
    monkeypatch.setattr(lattice, "ladder", lambda cases: [worse])
    monkeypatch.setattr(label_counts, "read", lambda: {"m7 at 0.25 m": OLD})
    monkeypatch.setattr("sys.argv", ["lattice.py", "--out", str(out)])
    with pytest.raises(SystemExit, match=r"m7 at 0.25 m: labels generated 1000 -> 1300"):
        lattice.main()
    assert json.loads(out.read_text())["instances"] == [worse]


@pytest.mark.proof
def test_the_benchmark_of_tours_counts_a_layer_for_each_set_of_visited_stops(module):
    tours = module("tours")
    alone, in_order, free = (tours.searched(tours.Case(1.0, *case)) for case in ((0,), (3, "given"), (3, "any")))
    assert [figures["layers"] for _, figures in (alone, in_order, free)] == [1, 4, 8]
    states = alone[1]["nodes"]
    for _, figures in (in_order, free):
        assert figures["nodes"] == figures["layers"] * states + 1  # and the goal from which stops could be skipped
        assert figures["labels"] >= figures["front"] > 0
    # Each given tour is also one in any order, and each tour is a path without stops.
    for better, worse in ((free, in_order), (alone, free)):
        costs = better[0].costs
        assert all((costs <= row).all(axis=1).any() for row in worse[0].costs)
    assert set(tours.measured(tours.Case(1.0, 1))) >= {"build_s", "search_s", "own_mb", "process_mb", "prototype_s"}


def test_make_bench_runs_every_benchmark_that_writes_its_figures():
    texts = {file.name: file.read_text() for file in BENCHMARKS.glob("*.py")}
    writing = {name for name, text in texts.items() if '"--out", type=Path' in text and "png" not in text}
    made = (BENCHMARKS.parent / "Makefile").read_text()
    assert {name for name in writing if f"benchmarks/{name} --out" not in made} == set()
    assert "arm_plans.py" in writing


def test_an_absent_map_is_skipped_with_a_line(module, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(module("maps"), "DATA", tmp_path)
    assert module("lattice").ladder([("pal_office", 0.25)]) == []
    said = capsys.readouterr().out
    assert said.startswith("pal_office skipped")
    assert "HPOP_DATA" in said


def test_every_instance_of_make_bench_has_a_reference(module, label_counts):
    lattice = module("lattice")
    titles = {
        label_counts.title({"instance": name, "step": step, "eps": eps})
        for name, step in lattice.CASES + lattice.LARGE
        for eps in lattice.PRECISIONS
    }
    assert titles == set(label_counts.read())


def test_the_smallest_museum_needs_no_more_labels_than_its_reference(module, label_counts, monkeypatch):
    lattice = module("lattice")
    monkeypatch.setattr(lattice, "RUNS", 1)
    rows = lattice.measured("m60", 0.25)
    assert {label_counts.title(row) for row in rows} <= set(label_counts.read())
    assert label_counts.regressions(rows, label_counts.read()) == []


def test_an_instance_folder_gives_one_row_and_its_front(module, tmp_path):
    # Two ways from 0 to 2: by node 1, and straight.
    np.array([0, 2, 3, 3], np.int64).tofile(tmp_path / "indptr.bin")
    np.array([1, 2, 2], np.int32).tofile(tmp_path / "heads.bin")
    np.array([[1, 0, 4], [9, 0, 3], [1, 1, 4]], np.int32).tofile(tmp_path / "costs.bin")
    (tmp_path / "meta.txt").write_text("3 1 0 2\n")
    row = module("lattice").instance(tmp_path)
    assert list(row) == ["build_s", "search_s", "front", "labels_generated", "labels_expanded", "peak_mb"]
    assert row["front"] == 2
    assert (tmp_path / "front_hpop.txt").read_text() == "2 1 8\n9 0 3\n"


def test_who_walks_on_as_before_is_predicted_without_an_error(module):
    corridor = module("corridor")
    t = np.arange(0.0, 10.1, 0.5)
    walkers = {i: Track(t + 15.0 * i, -5.0 + t, 1.0 + 0.1 * i + 0.05 * t, recorded=True) for i in range(8)}
    found = corridor.errors(walkers)
    assert list(found.values()) == pytest.approx([0.0] * 3, abs=1e-9)
    (person,) = corridor.predicted(walkers, 33.0)
    assert (person.name, person.velocity) == ("2", pytest.approx((1.0, 0.05)))
    assert [person.name for person in corridor.recorded(walkers, 33.0)] == ["2", "3"]  # the next comes 12 s later
    turned = Track([0.0, 5.0, 10.0], [0.0, 5.0, 0.0], [0.0, 0.0, 0.0], recorded=True)
    assert corridor.errors({1: turned.later(-16.0)})["2 s"] == pytest.approx(
        math.sqrt(2.0**2 / 2)
    )  # it turns back at 21 s


@pytest.mark.proof
@pytest.mark.parametrize("seeds", [0, 3])
def test_plain_label_setting_on_a_clock_finds_all(module, seeds):
    plain, asked = module("plain_timed"), 0
    for query in map(timed_query, range(300)):
        if set(query.graph.graph.aggregates) == {"sum"}:
            found = plain.plain_front(query.graph, query.source, list(query.targets), seeds=seeds, most=20_000)
            assert [tuple(row) for row in found.costs.tolist()] == front_by_enumeration(query)
            asked += 1
    assert asked > 50


@pytest.mark.parametrize(
    ("kept", "today"),
    [
        (
            "8 headings, no corner cutting for (turns, length); paths",
            "8 headings, no corner cutting, for (turns, length); paths",
        ),
        (
            "20 samples and 8 neighbours of each and 6 links of each to states farther away, 3 guides for (jerk)",
            "20 samples and 8 neighbours and 6 far links of each, 3 guides, for (jerk)",
        ),
        (
            "spline: 3 splines, each proved free of collisions and no worse than its path in (jerk), and 1 path, "
            "2 not smoothed yet; local improvements, not proved to be optimal",
            "spline: the best of 3 splines and 1 path, 2 not smoothed yet; each spline is proved free of collisions "
            "and no worse than its path in (jerk); these are local improvements, not proved to be optimal",
        ),
    ],
)
def test_certificates_of_kept_fronts_are_compared_in_the_words_of_today(module, kept, today):
    reworded = module("fronts").reworded
    assert reworded(kept) == reworded(today) == today


@pytest.mark.proof
def test_criteria_of_rotation_order_the_papers_paths_as_its_participants_sickness_did(module):
    """Medians of the SSQ: least turns 9.35, shortest 14.96, RRT 20.57; people liked the shortest most (2002.10696)."""
    ranks = {row["criterion"]: row for row in module("ratings").museum(runs=10, step=0.5).rows()}
    for name in ("turns", "rotation", "rotation_time", "angular_acceleration", "sickness", "msdv"):
        assert ranks[name]["sickness (SSQ)"] == pytest.approx(1.0), name
    assert ranks["length"]["dislike"] == pytest.approx(1.0)


def test_optic_flow_agrees_that_people_feel_better_farther_from_walls(module):
    """Suomalainen et al. 2021; by hand, the largest flow at distance d is v/d."""
    rows = {row["criterion"]: row for row in module("ratings").distances().rows()}
    assert rows["optic_flow"]["discomfort"] == pytest.approx(1.0)
    assert [rows["peak_optic_flow"][d] for d in ("0.5 m", "1 m", "2 m")] == pytest.approx([2.0, 1.0, 0.5])


def test_an_unwound_picture_does_not_rotate_and_is_predicted_to_sicken_less(module):
    """People felt less sick with it (Suomalainen et al. 2022)."""
    rows = {row["criterion"]: row for row in module("ratings").unwound(step=1.0).rows()}
    assert rows["rotation"]["unwound"] == 0.0 < rows["rotation"]["coupled"]
    assert rows["sickness"]["unwound"] < rows["sickness"]["coupled"]


@pytest.mark.proof
@pytest.mark.skipif(sys.platform != "linux", reason="the goal is that of Linux: libraries take other memory elsewhere")
@pytest.mark.parametrize("case", ["Case(0.5, 6, 'any', 0.01)", "Case(0.25, 4, 'any')"])
def test_tours_take_at_most_a_third_of_the_memory_of_copied_layers(case):
    command = f"import tours; print(tours.measured(tours.{case})['process_mb'])"
    for _ in range(2):  # the first process may compile code, which takes memory of its own
        run = subprocess.run(
            [sys.executable, "-c", command], cwd=BENCHMARKS, capture_output=True, text=True, check=True
        )
    assert float(run.stdout) <= 1100 / 3  # a prototype with copied layers took 1,100 MB
