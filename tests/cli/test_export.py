"""`hpop export` and `hpop formats`: the files that Python writes, and mistakes that end in one message."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from hpop.base.registry import formats
from hpop.export import save
from hpop.problems.front import Front
from hpop.scenario import load_scenario

Run = Callable[..., Result]


def test_it_writes_what_python_writes(run: Run, folder: Path, tmp_path: Path) -> None:
    options = ["--rows", "knee,0", "--rows", "length", "--format", "tum,glb", "--format", "csv", "--rate", "5"]
    result = run("export", folder, *options, "--planned", "--body", "base", "--out", tmp_path / "cli")
    assert result.exit_code == 0, result.output
    front = Front.load(folder / "front.json")
    problem = load_scenario(folder.parent / "room.yaml").problem
    written = save(
        problem,
        front,
        tmp_path / "python",
        rows=["knee", 0, "length"],
        formats=["tum", "glb", "csv"],
        rate=5,
        planned=True,
        body="base",
    )
    assert f"written to {tmp_path / 'cli'}: {written[0].name}, " in result.output.replace("\n", " ")
    for path in written:
        assert (tmp_path / "cli" / path.name).read_bytes() == path.read_bytes()
    assert len(list((tmp_path / "cli").iterdir())) == len(written)


def test_by_default_it_is_the_knee_as_csv_beside_the_front(run: Run, folder: Path) -> None:
    knee = Front.load(folder / "front.json").knee().index
    assert run("export", folder).exit_code == 0
    assert run("export", folder / "front.json").exit_code == 0
    names = {path.name for path in (folder / "export").iterdir()}
    assert names == {f"knee_{knee}.csv", f"knee_{knee}.about.json"}


def test_streams_need_no_map(run: Run, folder: Path, tmp_path: Path) -> None:
    """A front that was moved alone: its map is not there, which only what shows the world asks for."""
    (tmp_path / "front.json").write_bytes((folder / "front.json").read_bytes())
    moved = (tmp_path / "front.json").read_text().replace("map.yaml", "gone.yaml")
    (tmp_path / "front.json").write_text(moved)
    assert run("export", tmp_path, "--format", "tum,nav2-yaml").exit_code == 0
    assert run("export", tmp_path, "--format", "glb", "--out", tmp_path / "none").exit_code == 3
    assert not (tmp_path / "none").exists()
    both = run("export", tmp_path, "--format", "csv,glb", "--out", tmp_path / "both")
    assert both.exit_code == 3
    assert "so glb, which needs the map, is not written" in " ".join(both.stderr.split())
    assert {path.suffix for path in (tmp_path / "both").iterdir()} == {".csv", ".json"}


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (["--rows", "99"], 10, "no row 99: the front has row 0 alone"),
        (["--rows", "kneee"], 7, "no row is called 'kneee'. Did you mean 'knee'"),
        (["--format", "tumm"], 7, "unknown format 'tumm'. Did you mean 'tum'"),
        (["--rate", "0"], 10, "rate must be a number of poses a second, in Hz"),
        (["--body", "tool"], 10, "this robot has no body 'tool'"),
        (["--frame-id", "/map"], 10, "the name of a frame must not begin with a slash"),
    ],
)
def test_mistakes_are_told(run: Run, refused, folder: Path, tmp_path: Path, options, code: int, said: str) -> None:
    refused(run("export", folder, *options, "--out", tmp_path / "out"), code, said)
    assert not list(tmp_path.rglob("*.csv"))


def test_nothing_between_commas_is_told(run: Run, folder: Path) -> None:
    result = run("export", folder, "--rows", "knee,")
    assert result.exit_code == 2
    assert "expected names or numbers between commas, such as knee,3" in result.stderr


def test_a_folder_without_a_front_is_told(run: Run, refused, tmp_path: Path) -> None:
    refused(
        run("export", tmp_path), 12, "front.json: No such file or directory; give the folder that `hpop plan` wrote"
    )
    (tmp_path / "front.json").write_text("{}")
    refused(run("export", tmp_path), 12, "front.json")


def test_formats_are_listed_with_their_axes(run: Run) -> None:
    text = " ".join(run("formats").output.split())
    for name, each in formats.items():
        assert f"{name} {each.suffix} " in text
        assert f"Axes: {' '.join(each.axes.split())}." in text
