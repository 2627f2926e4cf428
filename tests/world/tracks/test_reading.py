"""Tracks from files: what each format says, and what is refused."""

from __future__ import annotations

import math
import os
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import hpop
from hpop.errors import MapError
from hpop.world import Track

PETRACK = """# PeTrack project: corridor.pet
# framerate: 20 fps
# id frame x/cm y/cm z/cm
1 40 100 250.5 176
1 42 110 250.5 176
2 41 -300 20 180
1 44 130 255 176
2 43 -290 20 180
"""
CSV = "id,t,x,y\nAda,0,1.0,2.0\nAda,0.5,1.5,2.0\n7,0.25,0,0\n7,1.25,0,1\n"
# The layout of the ETH data set, not its content: frame id x z y vx vz vy.
OBSMAT = """ 7.80e+02 1.0e+00 8.456 0.0 3.588 1.671 0.0 0.306
 7.86e+02 1.0e+00 9.125 0.0 3.658 1.677 0.0 0.174
 7.92e+02 1.0e+00 9.795 0.0 3.728 1.677 0.0 0.174
"""


def written(folder: Path, text: str, name: str = "tracks.txt") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_petrack_files_say_unit_and_frame_rate(tmp_path):
    tracks = hpop.read_tracks(written(tmp_path, PETRACK))
    assert list(tracks) == [1, 2]
    assert tracks[1] == Track([2.0, 2.1, 2.2], [1.0, 1.1, 1.3], [2.505, 2.505, 2.55], recorded=True)
    assert tracks[2] == Track([2.05, 2.15], [-3.0, -2.9], [0.2, 0.2], recorded=True)


@pytest.mark.parametrize("said", ["# unit: cm", "#Units = cm"])
@pytest.mark.parametrize(
    "rows", ["9 100 450 125 176\n9 125 350 150 176\n", "id,frame,x,y\n9,100,450,125\n9,125,350,150\n"]
)
def test_a_unit_in_a_comment_of_its_own_is_read(tmp_path, said, rows):
    tracks = hpop.read_tracks(written(tmp_path, f"# framerate: 25\n{said}\n{rows}"))
    assert tracks == {9: Track([4.0, 5.0], [4.5, 3.5], [1.25, 1.5], recorded=True)}


def test_petrack_files_without_a_unit_are_in_metres(tmp_path):
    head = "# description: corridor\n# framerate: 25.00\n\n# PersID\tFrame\tX\tY\tZ\n"
    text = f"{head}9\t100\t4.5\t1.25\t1.76\n9\t125\t3.5\t1.5\t1.76\n"
    assert hpop.read_tracks(written(tmp_path, text)) == {9: Track([4.0, 5.0], [4.5, 3.5], [1.25, 1.5], recorded=True)}


@pytest.mark.parametrize(
    ("text", "options"),
    [
        (CSV, {}),
        (CSV.partition("\n")[2], {}),
        (CSV.replace(",", ";"), {"unit": "m"}),
        (CSV.replace(",", "\t"), {}),
        ("# drawn by hand\n\n" + CSV, {"format": "csv"}),
        ("y/cm,x/cm,frame,agent_id\n200,100,0,Ada\n200,150,10,Ada\n0,0,5,7\n100,0,25,7\n", {"frame_rate": 20}),
        ("id,time [s],x [mm],y [mm],note\nAda,0,1000,2000,a\nAda,0.5,1500,2000,b\n7,.25,0,0,c\n7,1.25,0,1e3,d\n", {}),
        ("Ada,0,100,200\nAda,10,150,200\n7,5,0,0\n7,25,0,100\n", {"frame_rate": 20, "unit": "cm"}),
    ],
)
def test_csv_may_name_its_columns_or_have_them_in_order(tmp_path, text, options):
    tracks = hpop.read_tracks(written(tmp_path, text, "tracks.csv"), **options)
    assert tracks == {
        "Ada": Track([0.0, 0.5], [1.0, 1.5], [2.0, 2.0], recorded=True),
        7: Track([0.25, 1.25], [0.0, 0.0], [0.0, 1.0], recorded=True),
    }


def rows_of(people, per_second, steps=30):
    """Rows (frame, id, x, y), sorted by frame: people walk side by side at 1.25 m/s, two metres apart."""
    return [(step, one, 1.25 * step / per_second, 2.0 * one) for step in range(steps) for one in range(1, people + 1)]


def in_lines(rows, separator, header=""):
    return header + "".join(separator.join(f"{value:g}" for value in row) + "\n" for row in rows)


@pytest.mark.parametrize("separator", ["\t", " ", ",", ";"])
@pytest.mark.parametrize("people", [1, 5])
def test_frames_may_come_before_ids_as_eth_and_ucy_are_passed_on(tmp_path, separator, people):
    tracks = hpop.read_tracks(written(tmp_path, in_lines(rows_of(people, 2.5), separator)), frame_rate=2.5)
    assert list(tracks) == list(range(1, people + 1))
    assert all(np.hypot(*track.velocity(track.times[:-1])) == pytest.approx(1.25) for track in tracks.values())
    (note,) = tracks.notes
    assert "taken as frame,id,x,y; name them in a first line" in note


def test_ids_still_come_first_without_a_header_where_steps_say_so(tmp_path):
    rows = sorted((one, frame, x, y) for frame, one, x, y in rows_of(3, 2.5))
    tracks = hpop.read_tracks(written(tmp_path, in_lines(rows, ",")), frame_rate=2.5)
    assert list(tracks) == [1, 2, 3]
    assert "taken as id,frame,x,y" in tracks.notes[0]
    timed = [(frame / 2.5, one, x, y) for frame, one, x, y in rows_of(3, 2.5)]
    tracks = hpop.read_tracks(written(tmp_path, in_lines(timed, ",")))
    assert tracks[2].times == pytest.approx(np.arange(30) / 2.5)
    assert "taken as t,id,x,y" in tracks.notes[0]
    counted = [(i, *row) for i, row in enumerate(rows)]  # as pandas writes an index
    assert list(hpop.read_tracks(written(tmp_path, in_lines(counted, ",")), frame_rate=2.5)) == [1, 2, 3]


UNITS = [("time/ms", 1e3), ("t_ms", 1e3), ("time [us]", 1e6), ("t (min)", 1 / 60), ("time_s", 1)]
EPOCHS = [("timestamp", 1), ("timestamp", 1e3), ("t", 1e9), ("time/ms", 1e3)]


@pytest.mark.parametrize(
    ("title", "factor", "begin"), [(*one, 0) for one in UNITS] + [(*one, 1.7e9 * one[1]) for one in EPOCHS]
)
def test_times_have_the_unit_of_their_title_or_count_from_1970(tmp_path, title, factor, begin):
    lines = "".join(f"A,{begin + 0.5 * i * factor:.18g},{0.5 * i},2\n" for i in range(4))
    tracks = hpop.read_tracks(written(tmp_path, f"id,{title},x/m,y/m\n{lines}"))
    assert tracks["A"].times == pytest.approx([0.0, 0.5, 1.0, 1.5], abs=1e-6)
    said = "counts time from 1970 on; its first, 2023-11-14 22:13:20.000+00:00, is taken as 0 s"
    assert (said in str(tracks.notes)) == bool(begin)


def test_times_may_be_dates(tmp_path):
    text = "id,time,x,y\nA,2023-11-14T12:00:00.5,0,0\nA,2023-11-14 12:00:02,1,0\n"
    assert hpop.read_tracks(written(tmp_path, text))["A"].times == pytest.approx([0.0, 1.5])


def test_numbers_may_have_decimal_commas(tmp_path):
    expected = {7: Track([0.0, 0.5], [1.25, 1.5], [2.0, 2.0], recorded=True)}
    for text in ("id;t;x;y\n7;0,0;1,25;2\n7;0,5;1,5;2,0\n", "7\t0,0\t1,25\t2\n7\t0,5\t1,5\t2,0\n"):
        assert hpop.read_tracks(written(tmp_path, text)) == expected
    assert hpop.read_tracks(written(tmp_path, "7 0,0 1,25 2\n7 0,5 1,5 2,0\n")) == expected


def test_jupedsim_wrote_text_with_the_names_of_columns_in_a_comment(tmp_path):
    head = "#description: jpscore (0.9.0)\n#framerate: 8.00\n#ID: the agent ID\n#FR: the current frame\n"
    rows = (
        "#ID\tFR\tX\tY\tZ\tA\tB\tANGLE\tCOLOR\n1\t8\t1.5\t3.5\t0\t.3\t.3\t0\t255\n1\t16\t2.5\t3.5\t0\t.3\t.3\t0\t255\n"
    )
    tracks = hpop.read_tracks(written(tmp_path, head + rows))
    assert tracks == {1: Track([1.0, 2.0], [1.5, 2.5], [3.5, 3.5], recorded=True)}
    assert "columns that are not read: A, B, ANGLE, COLOR" in tracks.notes[0]
    turned = "# framerate: 2\n# frame id x/cm y/cm\n0 7 100 0\n1 7 150 0\n"
    assert hpop.read_tracks(written(tmp_path, turned)) == {7: Track([0.0, 0.5], [1.0, 1.5], [0.0, 0.0], recorded=True)}


def database(path, rows, fps="8"):
    """Write a database as JuPedSim's sqlite writer does (schema of its documentation)."""
    with closing(sqlite3.connect(path)) as base:
        base.execute("CREATE TABLE trajectory_data (frame INTEGER, id INTEGER, pos_x REAL, pos_y REAL, ori_x REAL)")
        base.execute("CREATE TABLE metadata (key TEXT NOT NULL UNIQUE PRIMARY KEY, value TEXT NOT NULL)")
        base.execute("INSERT INTO metadata VALUES ('version', '1'), ('fps', ?)", [fps])
        base.executemany("INSERT INTO trajectory_data VALUES (?, ?, ?, ?, 0)", rows)
        base.commit()
    return path


def test_jupedsim_writes_databases(tmp_path):
    path = database(tmp_path / "out.sqlite", [(8, 1, 1.5, 3.5), (8, 2, 0, 0), (16, 1, 2.5, 3.5), (16, 2, 1, 0)])
    tracks = hpop.read_tracks(path)
    assert tracks == hpop.read_tracks(path, format="jupedsim")
    assert list(hpop.read_tracks(path, ids=np.array([2]))) == [2]
    assert tracks[1] == Track([1.0, 2.0], [1.5, 2.5], [3.5, 3.5], recorded=True)
    with pytest.raises(MapError, match="states a frame rate of 8 per second, but frame_rate is 10"):
        hpop.read_tracks(path, frame_rate=10)
    for rows, message in (([(0, 1, None, 0)], "cells that are no numbers"), ([], "has no rows")):
        with pytest.raises(MapError, match=message):
            hpop.read_tracks(database(tmp_path / f"{message}.sqlite", rows))
    with closing(sqlite3.connect(tmp_path / "other.sqlite")) as base:
        base.execute("CREATE TABLE persons (id)")
    with pytest.raises(MapError, match="lacks the table metadata, trajectory_data: expected JuPedSim's tables"):
        hpop.read_tracks(tmp_path / "other.sqlite")
    (tmp_path / "cut.sqlite").write_bytes(path.read_bytes()[:5000])
    with pytest.raises(MapError, match="cannot be read as SQLite"):
        hpop.read_tracks(tmp_path / "cut.sqlite")


def noted(tmp_path, rows, **options):
    tracks = hpop.read_tracks(written(tmp_path, in_lines(rows, ",", "id,t,x,y\n")), **options)
    return tracks, " ".join(tracks.notes)


WALK = [(1, 0.5 * i, 0.5 * i, 0.0) for i in range(61)]  # 30 s at 1 m/s


def test_who_is_there_once_is_left_out_and_told(tmp_path):
    tracks, notes = noted(tmp_path, [*WALK, (2, 3, 0, 0), (314, 3, 5, 5)])
    assert list(tracks) == [1]
    assert "has people at one time only, who are left out: 2, 314" in notes


def test_rows_out_of_order_are_sorted_and_those_twice_count_once(tmp_path):
    tracks, notes = noted(tmp_path, [*WALK[30:], *WALK[:30], WALK[7], (2, 0, 5, 5), (2, 1, 5, 5)])
    expected, _ = noted(tmp_path, [*WALK, (2, 0, 5, 5), (2, 1, 5, 5)])
    assert tracks == expected
    assert "not in order of time; they are sorted: 1" in notes
    assert "repeats 1 row; each counts once: 1" in notes


def test_who_is_missing_for_a_while_is_told_and_comes_back_as_another_after_long(tmp_path):
    tracks, notes = noted(tmp_path, WALK[:10] + WALK[20:])
    assert list(tracks) == [1]
    assert (
        "has people who are missing for a while, and are assumed to walk straight meanwhile: 1 after 4.5 s, for 5.5 s"
        in notes
    )
    tracks, notes = noted(tmp_path, WALK[:10] + WALK[40:])
    assert {name: (track.begin, track.end) for name, track in tracks.items()} == {1: (0, 4.5), "1 (2)": (20, 30)}
    assert "missing for more than 10 s, and then count as other people: 1 after 4.5 s, for 15.5 s" in notes
    assert list(noted(tmp_path, WALK[:10] + WALK[40:], ids=[1])[0]) == [1, "1 (2)"]
    waypoints = [(1, 0, 0, 0), (1, 2, 2, 0), (1, 40, 30, 0)]
    assert noted(tmp_path, waypoints)[1] == ""  # nobody watched: they are waypoints


def test_who_is_missing_in_a_short_track_comes_back_as_another_too(tmp_path):
    times = (0, 0.4, 0.8, 1.2, 61.2, 61.6, 62)
    short = [(1, t, 0.5 * i, 0.0) for i, t in enumerate(times)]
    tracks, notes = noted(tmp_path, short)
    assert {name: (track.begin, track.end) for name, track in tracks.items()} == {1: (0, 1.2), "1 (2)": (61.2, 62)}
    assert "missing for more than 10 s, and then count as other people: 1 after 1.2 s, for 60 s" in notes
    tracks, notes = noted(tmp_path, [*short, *((1, t + 100, x, y) for _, t, x, y in short[:3])])
    assert list(tracks) == [1, "1 (2)", "1 (3)"]


def test_a_gap_between_irregular_or_slow_rows_is_told(tmp_path):
    irregular = [(1, t, 0.1 * t, 0.0) for t in (0, 0.2, 0.4, 0.6, 1.4, 1.6, 2.5, 2.7, 30, 30.2)]
    slow = [(1, t, 0.1 * t, 0.0) for t in (0, 2, 4, 6, 8, 50, 52)]
    for rows, gap in ((irregular, "1 after 2.7 s, for 27.3 s"), (slow, "1 after 8 s, for 42 s")):
        tracks, notes = noted(tmp_path, rows)
        assert list(tracks) == [1]
        assert f"missing for a while, and are assumed to walk straight meanwhile: {gap}" in notes


def test_nobody_jumps_in_a_short_track(tmp_path):
    tracks, notes = noted(tmp_path, [(1, 0.4 * i, 0.4 * i + 20.0 * (i > 3), 0.0) for i in range(7)])
    assert {name: track.speed for name, track in tracks.items()} == pytest.approx({1: 1.0, "1 (2)": 1.0})
    assert "has people who jump (faster than 10 m/s), and then count as other people: 1 after 1.2 s, for 0.4 s" in notes
    often = [(1, 0.4 * i, 8.0 * (i % 4 == 3), 0.0) for i in range(30)]
    tracks, notes = noted(tmp_path, often)
    assert list(tracks) == [1]
    assert "faster than 10 m/s in 14 steps of 29; check the unit and the frame rate: 1" in notes


def test_nobody_jumps(tmp_path):
    other = [(1, t, x + 40.0, y) for _, t, x, y in WALK[31:]]  # another person under the same id
    tracks, notes = noted(tmp_path, [*WALK[:31], *other])
    assert {name: track.speed for name, track in tracks.items()} == pytest.approx({1: 1.0, "1 (2)": 1.0})
    assert "has people who jump (faster than 10 m/s), and then count as other people: 1 after 15 s, for 0.5 s" in notes
    wrong = [*WALK[:31], (1, 15.5, -30.0, 8.0), *WALK[32:]]
    tracks, notes = noted(tmp_path, wrong)
    assert list(tracks) == [1]
    assert tracks[1].speed == pytest.approx(1.0)
    assert tracks[1].times.size == 60
    assert (
        "single points that take more than 10 m/s to reach and to leave again; they are left out: 1 at 15.5 s" in notes
    )


def test_obsmat_was_annotated_two_and_a_half_times_a_second(tmp_path):
    (track,) = hpop.read_tracks(written(tmp_path, OBSMAT)).values()
    np.testing.assert_allclose(np.diff(track.times), 0.4)
    np.testing.assert_allclose(track.x, [8.456, 9.125, 9.795])
    np.testing.assert_allclose(track.y, [3.588, 3.658, 3.728])
    np.testing.assert_allclose(np.hypot(*track.velocity(track.times[:-1])), [1.68, 1.68], atol=0.01)  # as the file says
    (given,) = hpop.read_tracks(written(tmp_path, OBSMAT), frame_rate=30).values()
    np.testing.assert_allclose(np.diff(given.times), 0.2)


def test_some_of_a_file_may_be_asked_for(tmp_path):
    path = written(tmp_path, PETRACK + "3 50 0 0 170\n")  # one point only, of whom nobody asks
    assert list(hpop.read_tracks(path, ids=[2, 1])) == [2, 1]
    with pytest.raises(MapError, match="has no id 4; it has 3 ids: 1, 2, 3"):
        hpop.read_tracks(path, ids=[4])
    with pytest.raises(MapError, match="ids that repeat 2"):
        hpop.read_tracks(path, ids=[2, 2])


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("id,t,x,y\n1,1,0,0\n1,1,1,0\n", {}, "at the id 1: .* the same time twice"),
        (PETRACK + "3 50 0 0 170\n", {"ids": [3]}, "at the id 3: a track must have 2 to .* got 1"),
        (
            "id,t,x,y\n1,0,0,0\n2,0,5,0\n",
            {},
            "no person with rows at two times that can be joined to a track; it has 2 ids",
        ),
        ("id,time/h,x,y\n1,0,0,0\n", {}, "has times in an unknown unit: h; convert them to one of s, "),
        ("id,date,x,y\n1,2023-11-14,0,0\n", {}, "lacks a column for t or frame"),
        ("id,time,x,y\n1,2023-11-14 12:00:00,0,0\n1,soon,0,0\n", {}, "has 'soon' in the column t of line 3; .* date"),
        (
            '{"track": {"f": 1, "p": 1, "x": 0, "y": 0}}',
            {},
            "is JSON, which hpop does not read; write it as CSV: a line id,t,x,y",
        ),
        ("1,0,0,0\n1,1,150,0\n", {}, "faster than anybody .* taken as id,t,x,y; name them in a first line"),
        ("id,t,x,y\n1,0,0,0\n1,1,nan,0\n", {}, "has 'nan' in the column x of line 3; expected a finite number"),
        (PETRACK.replace("110", "inf"), {}, "expected rows of 4 or 5 numbers .*; line 5 is '1 42 inf 250.5 176'"),
        ("id,t,x,y\n1,0,0,0\n1,1,150,0\n", {}, "150 m/s, faster than anybody .* check the unit .*frame rate"),
        (PETRACK.replace("20 fps", "2000 fps"), {}, "faster than anybody"),
        ("id,frame,x,y\n1,0,0,0\n1,1,1,0\n", {}, "does not say how many there are per second; give frame_rate="),
        (CSV, {"frame_rate": 25}, "has times, not frames; leave frame_rate out"),
        (PETRACK, {"frame_rate": 25}, "states a frame rate of 20 per second, but frame_rate is 25; leave out"),
        (PETRACK, {"unit": "m"}, "says that positions are in cm, but unit is m; leave"),
        (PETRACK.replace("20 fps", "0 fps"), {}, "states a frame rate of 0 per second; expected more"),
        (PETRACK, {"unit": "feet"}, "must be one of m, cm, mm, got 'feet'"),
        (PETRACK, {"frame_rate": 0}, "frame_rate must be pictures a second"),
        (PETRACK, {"unit": ["m"]}, "the unit of a track must be one of m, cm, mm"),
        (PETRACK, {"ids": 3}, "ids must be a list of numbers and names"),
        (PETRACK, {"ids": [[3]]}, "ids must be a list of numbers and names"),
        (PETRACK, {"ids": [3, [4, 5]]}, "ids must be a list of numbers and names"),
        (PETRACK, {"format": "trc"}, "must be one of csv, petrack, obsmat, jupedsim"),
        (PETRACK, {"format": "obsmat"}, "expected rows of 8 numbers .*; line 4 is '1 40 100"),
        (PETRACK + "1 44\n", {}, "cannot be read: expected rows of 4 or 5 numbers .*; line 9 is '1 44'"),
        (PETRACK + "1 50 0 0\n", {}, "cannot be read: expected rows of 4 or 5 numbers .*; line 9 is '1 50 0 0'"),
        (PETRACK + "1 forty 0 0 0\n", {}, "cannot be read: .*line 9 is '1 forty 0 0 0'"),
        (PETRACK.replace("20 fps", "12,5 fps"), {}, "comment with the frame rate '12,5'; expected a number"),
        (PETRACK.replace("20 fps", "1" * 400), {}, "states a frame rate of inf per second; expected .* up to 10,000"),
        ("id,t,x,y\n1,0,0,0\n ,1,0,0\n", {}, "has no id in line 3"),
        (CSV, {"ids": []}, "ids must be a list of numbers and names"),
        ("# framerate: 25\n", {"format": "petrack"}, "has no rows"),
        ("id,t,x,y\n", {}, "has no rows"),
        ("# nothing\n", {}, "has no rows: expected rows of id, t, x, y"),
        ("id,t,x\n1,0,0\n", {}, "lacks a column for y"),
        ("id,when,x,y\n1,0,0,0\n", {}, "lacks a column for t or frame"),
        ("id,t,x,x,y\n1,0,0,0,0\n", {}, "has two columns for x"),
        (
            "id,t,x/ft,y/ft\n1,0,0,0\n",
            {},
            "has positions in an unknown unit: ft; convert them to one of m, cm, mm, and change the titles",
        ),
        ("id,t,x/m,y/cm\n1,0,0,0\n", {}, "has positions in several units: cm, m; convert all to one of these"),
        ("id,t,x,y\n1,0,0\n", {}, "a row with too few columns in line 2: .*; expected at least 4"),
        ("id,t,x,y\n1,soon,0,0\n", {}, "has 'soon' in the column t of line 2"),
        ("# recorded\n\nid,t,x,y\n1,0,0,0\n# a break\n1,1,0,0\n1,2,0,far\n", {}, "has 'far' in the column y of line 7"),
        ("1,0,0,0\n1,1,0,inf\n", {}, "has 'inf' in the column y of line 2"),
        ("1,2,3\n", {}, "has no header, and 3 columns"),
        ('id,t,x,y\n"1,0,0,0\n', {}, "cannot be read as CSV"),
        ("", {}, "is empty"),
    ],
)
def test_what_are_no_tracks_is_refused_with_the_file(tmp_path, text, options, message):
    with pytest.raises(MapError, match=message) as raised:
        hpop.read_tracks(written(tmp_path, text, "people.csv"), **options)
    assert "people.csv" in str(raised.value) or options


def test_a_file_is_regular_small_and_text(tmp_path):
    with pytest.raises(MapError, match="cannot be opened"):
        hpop.read_tracks(tmp_path / "none.csv")
    with pytest.raises(MapError, match="must be given by its path, a str or Path; got 3"):
        hpop.read_tracks(3)
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(MapError, match="UTF-8"):
        hpop.read_tracks(tmp_path / "binary")
    os.mkfifo(tmp_path / "fifo")
    with pytest.raises(MapError, match="a FIFO"):
        hpop.read_tracks(tmp_path / "fifo")
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(10**12)  # a hole: it takes no room
    with pytest.raises(MapError, match="at most 200,000,000 bytes"):
        hpop.read_tracks(tmp_path / "huge")


@pytest.mark.parametrize(
    ("name", "people", "ways"), [("bi_corr_400_b_03.txt", 480, {-1, 1}), ("traj_UNI_CORR_500_01.txt", 148, {-1})]
)
def test_real_people_walk_through_corridors_at_the_speed_of_people(name, people, ways, shared_data):
    """Ids, units and rates were read off the files' first lines by hand; directions are those of the file names."""
    path = shared_data("pedpy_corridors") / name
    tracks = hpop.read_tracks(path)
    lines = [line.split() for line in path.read_text().splitlines() if line and line[0] != "#"]
    assert len(tracks) == len({line[0] for line in lines}) == people
    assert sum(track.times.size for track in tracks.values()) == len(lines)
    metre = 100 if name.startswith("bi") else 1
    one, frame, x, y = (float(number) for number in lines[500][:4])
    assert [float(v) for v in tracks[int(one)].at(frame / 25)] == pytest.approx([x / metre, y / metre])
    ahead = [float(track.x[-1] - track.x[0]) for track in tracks.values()]
    assert {math.copysign(1, way) for way in ahead} == ways
    speeds = [abs(way) / (track.end - track.begin) for way, track in zip(ahead, tracks.values(), strict=True)]
    assert 0.4 < np.median(speeds) < 1.6
