"""Rasters and segments of the explorer, run by node as they are, against NumPy's counts of covered pixels."""

from __future__ import annotations

import itertools
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hpop.base.arrays import FloatArray, IntArray

WEB = Path(__file__).parents[2] / "web"
WIDTH, HEIGHT = 97, 61
# Reads questions, one JSON object a line, and answers each.
SCRIPT = """
import { Raster } from "./raster";
import { SegmentGrid, segmentsOf, usersOf } from "./segments";
import { readFileSync } from "node:fs";
const plain = (value: unknown) => JSON.stringify(value, (_, v) => (ArrayBuffer.isView(v) ? [...(v as any)] : v));
const answers: Record<string, (given: any) => unknown> = {
  lines: ({ width, height, lines, weights }) => {
    const raster = new Raster(width, height);
    lines.forEach(([x0, y0, x1, y1]: number[], i: number) => raster.line(x0, y0, x1, y1, weights[i]));
    return raster.counts;
  },
  points: ({ width, height, points, radius }) => {
    const raster = new Raster(width, height);
    for (const [x, y] of points) raster.point(x, y, radius);
    return raster.counts;
  },
  segments: ({ paths, selected, near, reach }) => {
    const found = segmentsOf(paths);
    const grid = new SegmentGrid(found);
    const picked = near.map(([x, y]: number[]) => grid.near(x, y, reach));
    return { ...found, users: usersOf(found, Uint8Array.from(selected)), near: picked };
  },
};
const lines = readFileSync(0, "utf8").trim().split("\\n").map((line) => JSON.parse(line));
process.stdout.write(plain(lines.map(({ ask, ...given }) => answers[ask](given))));
"""


def asked(*questions: dict[str, Any]) -> list[Any]:
    """Return the answers of the page's own modules."""
    esbuild, node = WEB / "node_modules" / ".bin" / "esbuild", shutil.which("node")
    if node is None or not esbuild.exists():
        pytest.skip("no node, or no packages in web/: npm ci")
    options = ["--bundle", "--platform=node", "--loader=ts", "--log-level=error"]
    bundled = subprocess.run(
        [esbuild, *options], input=SCRIPT, cwd=WEB / "src" / "explorer", capture_output=True, text=True, check=False
    )
    assert bundled.returncode == 0, bundled.stderr
    script = bundled.stdout
    given = "\n".join(json.dumps(question) for question in questions)
    ran = subprocess.run([node, "-e", script], input=given, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout)


def covered(lines: FloatArray, weights: IntArray) -> IntArray:
    """Count lines (HEIGHT, WIDTH): a flat line covers one pixel in each column, a steep one in each row."""
    counts = np.zeros((HEIGHT, WIDTH), dtype=np.int64)
    for (x0, y0, x1, y1), weight in zip(lines, weights, strict=True):
        flat = abs(x1 - x0) >= abs(y1 - y0)
        ends = sorted([(x0, y0), (x1, y1)]) if flat else sorted([(y0, x0), (y1, x1)])
        (a0, b0), (a1, b1) = ends
        along = np.arange(np.floor(a0), np.floor(a1) + 1)
        across = np.floor(np.interp(along + 0.5, [a0, a1], [b0, b1]))
        columns, rows = (along, across) if flat else (across, along)
        inside = (columns >= 0) & (columns < WIDTH) & (rows >= 0) & (rows < HEIGHT)
        np.add.at(counts, (rows[inside].astype(int), columns[inside].astype(int)), weight)
    return counts


@pytest.fixture(scope="module")
def lines() -> FloatArray:
    """Return lines (m, 4) of all slopes in both directions; the last ones are level, upright, and points."""
    rng = np.random.default_rng(3)
    any_way = rng.uniform([0, 0, 0, 0], [WIDTH, HEIGHT, WIDTH, HEIGHT], size=(200, 4))
    short = any_way[:60, [0, 1, 0, 1]] + rng.uniform(-2, 2, size=(60, 4))
    level = np.array([[3.3, 7.5, 90.2, 7.5], [50.5, 60.2, 50.5, 0.3], [4.4, 4.4, 4.4, 4.4], [0, 0, 96.99, 60.99]])
    return np.vstack([any_way, np.clip(short, 0, [WIDTH - 0.01, HEIGHT - 0.01] * 2), level])


@pytest.fixture(scope="module")
def answers(lines: FloatArray) -> dict[str, Any]:
    """All that this file asks, in one run of node."""
    rng = np.random.default_rng(4)
    outside = rng.uniform(-150, 250, size=(300, 4))
    points = rng.uniform([-3, -3], [WIDTH + 3, HEIGHT + 3], size=(80, 2))
    corners = rng.integers(0, 6, size=(60, 2)).astype(float)
    corners = np.unique(corners, axis=0)
    counts = rng.integers(1, 9, size=40)
    point = np.concatenate([rng.integers(0, len(corners), size=count) for count in counts])
    offsets = np.concatenate([[0], np.cumsum(counts)])
    near = rng.uniform(-1, 6, size=(50, 2))
    selected = rng.integers(0, 2, size=40)
    paths = {
        "offsets": offsets.tolist(),
        "point": point.tolist(),
        "points": len(corners),
        "x": corners[point, 0].tolist(),
        "y": corners[point, 1].tolist(),
    }
    size = {"width": WIDTH, "height": HEIGHT}
    weights = rng.integers(1, 9, size=len(lines))
    one = [{"ask": "lines", **size, "lines": [line.tolist()], "weights": [1]} for line in lines]
    found = asked(
        {"ask": "lines", **size, "lines": lines.tolist(), "weights": weights.tolist()},
        {"ask": "lines", **size, "lines": outside.tolist(), "weights": [1] * len(outside)},
        {"ask": "points", **size, "points": points.tolist(), "radius": 2.5},
        {"ask": "segments", "paths": paths, "selected": selected.tolist(), "near": near.tolist(), "reach": 0.4},
        *one,
    )
    raster = [np.array(counts).reshape(HEIGHT, WIDTH) for counts in (found[:3] + found[4:])]
    given = {"weights": weights, "outside": outside, "points": points, "corners": corners, "near": near}
    given |= {"point": point, "offsets": offsets, "selected": selected}
    return given | {
        "lines": raster[0],
        "cut": raster[1],
        "discs": raster[2],
        "one": raster[3:],
        "segments": found[3],
    }


def test_counts_are_those_of_the_pixels_that_numpy_says_are_covered(lines: FloatArray, answers: dict[str, Any]) -> None:
    assert answers["lines"].tolist() == covered(lines, answers["weights"]).tolist()


def test_a_line_has_no_gaps_and_counts_once_in_each_column_or_row(lines: FloatArray, answers: dict[str, Any]) -> None:
    for line, counts in zip(lines, answers["one"], strict=True):
        x0, y0, x1, y1 = np.floor(line)
        wide, high = abs(x1 - x0) + 1, abs(y1 - y0) + 1
        flat = abs(line[2] - line[0]) >= abs(line[3] - line[1])
        assert counts.max() == 1
        assert counts.sum() == (wide if flat else high)
        rows, columns = np.nonzero(counts if flat else counts.T)
        rows = rows[np.argsort(columns)]
        assert np.unique(columns).size == columns.size
        assert np.all(np.abs(np.diff(rows)) <= 1)


def test_what_lies_outside_is_cut_off_and_never_comes_in_at_the_other_side(answers: dict[str, Any]) -> None:
    expected = covered(answers["outside"], np.ones(len(answers["outside"]), dtype=np.int64))
    # At the border a line that leaves has a pixel that its middle is not in; within, not one differs.
    assert answers["cut"][1:-1, 1:-1].tolist() == expected[1:-1, 1:-1].tolist()
    assert expected.sum() > 3000
    more = answers["cut"] - expected
    assert more.min() >= 0
    assert more.sum() <= 2 * len(answers["outside"])


def test_points_are_discs_of_whole_pixels(answers: dict[str, Any]) -> None:
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    expected = np.zeros((HEIGHT, WIDTH), dtype=np.int64)
    for x, y in np.floor(answers["points"]):
        expected += (columns - x) ** 2 + (rows - y) ** 2 <= 2.5**2
    assert answers["discs"].tolist() == expected.tolist()


def test_distinct_segments_and_who_uses_them_are_those_counted_path_by_path(answers: dict[str, Any]) -> None:
    corners, point, offsets = answers["corners"], answers["point"], answers["offsets"]
    users: dict[frozenset[int], set[int]] = {}
    for row in range(len(offsets) - 1):
        ids = point[offsets[row] : offsets[row + 1]]
        for a, b in itertools.pairwise(ids):
            if a != b:
                users.setdefault(frozenset((int(a), int(b))), set()).add(row)
    found = answers["segments"]
    place = {tuple(corner): i for i, corner in enumerate(corners)}
    ends = zip(found["x0"], found["y0"], found["x1"], found["y1"], strict=True)
    keys = [frozenset((place[x0, y0], place[x1, y1])) for x0, y0, x1, y1 in ends]
    assert found["count"] == len(users) == len(set(keys))
    lists = np.split(found["rows"]["items"], found["rows"]["offsets"][1:-1])
    assert [set(map(int, rows)) for rows in lists] == [users[key] for key in keys]
    assert all(len(set(rows)) == len(rows) for rows in lists)
    assert found["users"] == [sum(int(answers["selected"][row]) for row in users[key]) for key in keys]


def test_segments_near_a_place_are_all_those_within_reach_the_nearest_first(answers: dict[str, Any]) -> None:
    found = answers["segments"]
    a = np.stack([found["x0"], found["y0"]], axis=1)
    b = np.stack([found["x1"], found["y1"]], axis=1)
    several = 0
    for place, picked in zip(answers["near"], found["near"], strict=True):
        along = np.clip(((place - a) * (b - a)).sum(1) / ((b - a) ** 2).sum(1), 0, 1)
        distance = np.hypot(*(place - a - along[:, None] * (b - a)).T)
        assert set(picked) == set(np.flatnonzero(distance <= 0.4).tolist())
        assert np.all(np.diff(distance[picked]) >= -1e-9)
        several += len(picked) > 1
    assert several > 10
