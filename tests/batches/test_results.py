"""The data set of a batch opens in other programs, with units; a line that was cut is no row; summaries by hand."""

import json

import numpy as np
import pytest
import shapely

import hpop
from hpop.batches import Results, batch, summaries, summary_lines
from hpop.batches.cases import Case
from hpop.batches.results import JOURNAL, Writer
from hpop.errors import OptionError, OutputError
from hpop.view import draw_batch

WORLD = hpop.World.from_polygons([shapely.box(3, 0, 4, 3)], extent=shapely.box(0, 0, 8, 6))
ROBOT = hpop.DifferentialDrive(radius=0.3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("batch")
    asked = {f"to {y}": hpop.Problem(WORLD, ROBOT, (1, 1, 0), (7, y, None), ["turns", "length"]) for y in (1, 5)}
    batch(asked, [{"lattice": {"step": 1.0}}, {"lattice": {"step": 0.5}}], out=out)
    return out


def test_pandas_polars_and_duckdb_read_the_same_lengths(folder):
    polars, duckdb = pytest.importorskip("polars"), pytest.importorskip("duckdb")
    parts = str(folder / "results" / "*.parquet")
    frame = Results(folder).frame()
    assert list(frame["name"].unique()) == ["to 1", "to 5"]
    expected = sorted(frame["cost_length"])
    assert sorted(polars.read_parquet(parts)["cost_length"].to_list()) == expected
    rows = duckdb.sql(f"select cost_length from '{parts}' order by 1").fetchall()
    assert [length for (length,) in rows] == expected


def test_units_stand_with_the_costs(folder):
    (table,) = Results(folder).tables(["cost_length"])
    assert table.schema.field("cost_length").metadata == {b"unit": b"m"}


def row(**more):
    return {"status": "complete", "error": None, "seconds": 1.0, "points": 1, "row": 0, **more}


def write(folder, rows_by_case):
    with Writer(folder) as writer:
        for number, (problem, planner, rows) in enumerate(rows_by_case):
            writer.write(Case(number, f"id {number}", problem, "w", planner, {}), rows)


def test_a_line_that_was_cut_is_no_row(tmp_path):
    write(tmp_path, [("p", "lattice", [row(costs={"length": 1.0})])])
    line = json.dumps({"id": "x", "values": {}, "rows": [row(case=7, id="x", problem="p", planner="a")]})
    (tmp_path / JOURNAL).write_text(line + "\n" + line[:40])
    assert [each["id"] for each in Results(tmp_path).table(["id"]).to_pylist()] == ["id 0", "x"]
    write(tmp_path, [])
    assert not (tmp_path / JOURNAL).exists()
    assert [each["id"] for each in Results(tmp_path).table(["id"]).to_pylist()] == ["id 0", "x"]


def test_results_of_other_criteria_stand_in_one_table(tmp_path):
    write(tmp_path, [("p", "lattice", [row(costs={"length": 1.0})])])
    write(tmp_path, [("q", "lattice", [row(costs={"turns": 2.0})])])
    assert Results(tmp_path).table(["cost_length", "cost_turns"]).to_pylist() == [
        {"cost_length": 1.0, "cost_turns": None},
        {"cost_length": None, "cost_turns": 2.0},
    ]


def test_rows_that_a_killed_process_left_in_both_places_are_read_once(tmp_path):
    write(tmp_path, [("p", "lattice", [row(costs={"length": 1.0})])])
    line = json.dumps({"id": "id 0", "values": {}, "rows": [row(case=0, id="id 0", problem="p", planner="lattice")]})
    (tmp_path / JOURNAL).write_text(line + "\n")
    assert Results(tmp_path).table(["id"]).to_pylist() == [{"id": "id 0"}]


def test_a_key_may_be_a_number_first_and_text_later_and_numbers_of_cases_may_come_twice(tmp_path):
    for identifier, value in (("b", 1.5), ("a", "coarse")):
        with Writer(tmp_path) as writer:
            rows = [row(row=k, points=2) for k in range(2)]
            writer.write(Case(0, identifier, "p", "w", "lattice", {"step": value}), rows)
    rows = Results(tmp_path).table(["case", "id", "row", "step"]).to_pylist()
    assert [tuple(each.values()) for each in rows] == [
        (0, "a", 0, "coarse"),
        (0, "a", 1, "coarse"),
        (0, "b", 0, "1.5"),
        (0, "b", 1, "1.5"),
    ]


def test_the_summary_compares_hypervolumes_of_one_problem(tmp_path):
    """Fronts (0, 10), (10, 0) and (5, 5): the reference lies a tenth beyond, at (11, 11).

    Together they hold 11 x 1 + 6 x 5 + 1 x 5 = 46; the first two alone 11 + 10 = 21, the last 36.
    """
    ends = [row(row=k, points=2, costs={"a": a, "b": 10.0 - a}) for k, a in enumerate((0.0, 10.0))]
    middle = [row(seconds=3.0, costs={"a": 5.0, "b": 5.0})]
    failed = {"status": "error", "error": "QueryError: no", "seconds": 0.1}
    none = {"status": "no path", "error": None, "seconds": 2.0, "points": 0}
    write(tmp_path, [("p", "one", ends), ("p", "two", middle), ("q", "one", [failed]), ("q", "two", [none])])
    one, two = summaries(Results(tmp_path))
    assert (one.counts, two.counts) == ({"complete": 1, "error": 1}, {"complete": 1, "no path": 1})
    assert (one.seconds.tolist(), two.seconds.tolist()) == ([1.0], [3.0, 2.0])
    assert (one.points.tolist(), two.points.tolist()) == ([2], [1, 0])
    np.testing.assert_allclose([one.shares, two.shares], [[21 / 46], [36 / 46]])
    assert "45.7 %" in summary_lines([one, two])[1]
    draw_batch([one, two], tmp_path / "figure.png")
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(OptionError, match=r"figure\.txt"):
        draw_batch([one], tmp_path / "figure.txt")


def test_a_folder_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write to"):
        Writer(tmp_path / "file")
    with pytest.raises(OutputError, match="holds no results"):
        Results(tmp_path / "none")
