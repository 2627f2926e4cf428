"""Files are whole or not there, earlier ones give way, and what cannot be written says what to do."""

from __future__ import annotations

import builtins
import json
import os
from pathlib import Path

import pytest

import hpop
from hpop.base.registry import formats
from hpop.errors import OptionError, OutputError, OwnCodeError, UnknownName
from hpop.export import Exported, export_format, save, write
from hpop.problems.front import Front
from tests.export.given import front, problem, robots

GOES = robots()["differential drive"]
pytestmark = pytest.mark.usefixtures("registered_as_before")


@pytest.mark.parametrize(
    ("name", "begins"),
    [
        ("cam.tum", "# trajectory: the camera as executed, 20 poses"),
        ("cam.csv", "# trajectory"),
        ("CAM.UNITY.CSV", "# trajectory: the camera as executed, 20 poses a second and the end; by hpop"),
        ("cam.euroc.csv", "#timestamp [ns],p_RS_R_x [m]"),
        ("cam.json", '{\n "schema": "hpop-poses"'),
        ("cam.nav2.yaml", "# trajectory: the path of the base"),
    ],
)
def test_the_ending_says_the_format_the_longest_that_fits(tmp_path, name, begins):
    path = write(GOES, tmp_path / name)
    assert path == tmp_path / name
    assert path.read_text().startswith(begins)


def test_a_format_can_be_named_where_the_ending_says_none(tmp_path):
    assert write(GOES, str(tmp_path / "poses.txt"), format="tum").read_text().count("\n") > 100
    with pytest.raises(
        OptionError, match=r"ending of a format, got 'poses.txt'; give one of .*\.tum \(tum\).*, or format="
    ):
        write(GOES, tmp_path / "poses.txt")
    with pytest.raises(UnknownName, match=r"unknown format 'tumm'\. Did you mean 'tum'"):
        write(GOES, tmp_path / "cam.tum", format="tumm")


@pytest.mark.parametrize(
    ("change", "error", "said"),
    [
        ({"trajectory": "knee"}, OptionError, "expected a trajectory, such as front.knee"),
        ({"path": 3}, OptionError, "expected a path to write to, such as 'out/knee.tum', got 3"),
        ({"path": ""}, OptionError, "expected a path"),
        ({"rate": -1}, OptionError, "rate must be a number of poses a second"),
        ({"body": "hand"}, OptionError, "no body 'hand'"),
    ],
)
def test_what_makes_no_sense_is_refused_and_nothing_is_written(tmp_path, change, error, said):
    given = {"trajectory": GOES, "path": tmp_path / "cam.tum"} | change
    with pytest.raises(error, match=said):
        write(**given)
    assert not list(tmp_path.iterdir())


def test_where_it_cannot_be_written_is_told_and_nothing_is_left(tmp_path):
    (tmp_path / "cam.tum").mkdir()
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "cam.tum", tmp_path / "file/cam.tum", tmp_path / "no\0.tum", tmp_path / "not/there.tum"):
        with pytest.raises(OutputError, match=r"cannot write .*; choose another path"):
            write(GOES, path)
    assert {path.name for path in tmp_path.iterdir()} == {"cam.tum", "file"}
    with pytest.raises(OutputError, match="cannot write"):
        save(problem(), front(), tmp_path / "file/out")


@pytest.mark.parametrize("made", ["text", None, {"a": "text"}])
def test_a_format_of_ones_own_that_makes_no_bytes_is_told(tmp_path, made):
    @export_format("no_bytes", suffix=".none", axes="none")
    def wrong(given: Exported) -> bytes:
        """Return something other than bytes."""
        return made

    with pytest.raises(OwnCodeError, match="format 'no_bytes' must return bytes"):
        write(GOES, tmp_path / "cam.none")
    assert not list(tmp_path.iterdir())


def test_where_one_of_several_formats_fails_the_others_are_written(tmp_path):
    @export_format("no_such_extra", suffix=".none", axes="none")
    def fails(given: Exported) -> bytes:
        """Fail as a format whose package is not installed."""
        raise ImportError("pip install it")

    @export_format("broken", suffix=".broken", axes="none")
    def breaks(given: Exported) -> bytes:
        """Fail by a fault of its own."""
        raise ZeroDivisionError("a fault")

    asked = ["no_such_extra", "csv", "broken", "tum"]
    with pytest.raises(OutputError, match="pip install it") as raised:
        save(problem(), front(), tmp_path / "out", rows=[0], formats=asked)
    files = ["row_0.about.json", "row_0.csv", "row_0.tum"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == files
    assert raised.value.__notes__[0] == "a fault"
    assert raised.value.__notes__[1].startswith(
        f"other formats are written to {tmp_path / 'out'}: row_0.csv, row_0.tum, row_0"
    )
    assert raised.value.__notes__[1].endswith("; not written: no_such_extra, broken")
    about = json.loads((tmp_path / "out/row_0.about.json").read_text())
    assert [file["format"] for file in about["files"]] == ["csv", "tum"]
    with pytest.raises(ZeroDivisionError):
        save(problem(), front(), tmp_path / "none", formats=["broken"])
    assert not (tmp_path / "none").exists()


def test_a_bag_that_may_not_take_its_place_keeps_no_other_format_from_being_written(tmp_path):
    (tmp_path / "row_0_bag").mkdir()
    with pytest.raises(OutputError, match="exists and is not a bag"):
        save(None, front(), tmp_path, rows=[0], formats=["bag", "tum"])
    assert (tmp_path / "row_0.tum").is_file()


def test_an_earlier_file_or_bag_gives_way_and_nothing_else_does(tmp_path):
    for name in ("cam.tum", "cam_bag"):
        first = write(GOES, tmp_path / name, rate=1)
        before = sizes(first)
        write(GOES, tmp_path / name, rate=2)
        assert sizes(first) > before
    (tmp_path / "mine_bag").mkdir()
    (tmp_path / "mine_bag/thesis.txt").write_text("years of work")
    with pytest.raises(OutputError, match="exists and is not a bag; remove it, or choose another name"):
        write(GOES, tmp_path / "mine_bag")
    assert (tmp_path / "mine_bag/thesis.txt").read_text() == "years of work"
    assert {path.name for path in tmp_path.iterdir()} == {"cam.tum", "cam_bag", "mine_bag"}


def sizes(path: Path) -> int:
    return sum(one.stat().st_size for one in ([path] if path.is_file() else path.iterdir()))


def test_a_bag_that_cannot_take_its_place_leaves_the_earlier_one(tmp_path, monkeypatch):
    path = write(GOES, tmp_path / "cam_bag", rate=2)
    before = {one.name: one.read_bytes() for one in path.iterdir()}
    rename = Path.rename

    def full(self, target):
        if str(target).endswith("cam_bag") and ".tmp" in self.name and not self.name.endswith(".old"):
            raise OSError(28, "No space left on device")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", full)
    with pytest.raises(OutputError, match="No space left on device"):
        write(GOES, path, rate=4)
    assert {one.name: one.read_bytes() for one in path.iterdir()} == before
    assert [one.name for one in tmp_path.iterdir()] == ["cam_bag"]


@pytest.mark.parametrize("name", ["mcap", "bag"])
def test_without_the_extra_it_says_how_to_get_it(tmp_path, monkeypatch, name):
    imported = builtins.__import__

    def without(module, *rest, **more):
        if module.startswith("rosbags"):
            raise ImportError(f"No module named {module!r}")
        return imported(module, *rest, **more)

    monkeypatch.setattr("hpop.base.lazy.import_module", without)
    with pytest.raises(OutputError, match=r"a bag needs rosbags.* pip install 'hpop\[bags\]'"):
        save(None, front(), tmp_path / "out", formats=[name])
    assert not list(tmp_path.iterdir())
    assert save(None, front(), tmp_path / "out", formats=["tum"])


def test_a_front_without_rows_a_row_that_is_not_there_and_a_world_that_is_not_given(tmp_path):
    none = Front.of([], [], names=["length"], status="no path")
    with pytest.raises(OptionError, match="the front has no trajectories; its search ended with 'no path'"):
        save(problem(), none, tmp_path / "out")
    with pytest.raises(OptionError, match="no row 3: the front has rows 0 to 2"):
        save(problem(), front(), tmp_path / "out", rows=[0, 3])
    with pytest.raises(OptionError, match="the format glb needs the world: give the problem"):
        save(None, front(), tmp_path / "out", formats=["glb"])
    with pytest.raises(OptionError, match=r"formats must be a list of names, such as \['tum', 'glb'\], got 'tum'"):
        save(problem(), front(), tmp_path / "out", formats="tum")
    assert not (tmp_path / "out").exists()


def test_nothing_is_asked_for_twice(tmp_path):
    written = save(None, front(), tmp_path, rows=["knee", 1, "knee"], formats=["tum", "tum"])
    assert [path.name for path in written] == ["knee_1.tum", "knee_1.about.json"]


def test_what_lies_beside_says_what_is_what(tmp_path):
    *_, about = save(None, front(), tmp_path, rows=[2], formats=["euroc"], rate=4, planned=True)
    told = json.loads(about.read_text())
    assert (told["schema"], told["version"], told["program"]) == ("hpop-export", 1, f"hpop {hpop.__version__}")
    assert (told["row"], told["rows"], told["name"], told["body"], told["rate"]) == (2, 3, "", "camera", 4)
    assert told["planned"] is True
    assert told["duration"] == front()[2].trajectory.duration
    assert told["units"] == dict(zip(front().names, front().units, strict=True))
    assert told["files"] == [{"file": "row_2.euroc.csv", "format": "euroc", "axes": formats["euroc"].axes}]


def test_a_format_of_your_own_is_a_function(tmp_path):
    @export_format("corners", suffix=".corners", axes="right-handed, x and y on the floor, z up, m; no times")
    def corners(given: Exported) -> bytes:
        """Write the corners of the base's path."""
        states = given.trajectory.states
        return "".join(f"{x:g} {y:g}\n" for x, y in zip(states.x, states.y, strict=True)).encode()

    assert write(GOES, tmp_path / "a.corners").read_text().startswith("1 1\n3 1\n")
    assert os.listdir(tmp_path) == ["a.corners"]
    with pytest.raises(OptionError, match=r"format name 'tum' is taken by hpop.export.streams.tum; choose another"):
        export_format("tum", suffix=".x", axes="")(lambda given: b"")
