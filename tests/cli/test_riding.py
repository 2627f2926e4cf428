"""`hpop ride --video`: a video of the row that is asked for, or what stands in its way."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import shapely
from click.testing import Result

import hpop

Run = Callable[..., Result]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two trajectories of a second and a half in a room."""
    world = hpop.World.from_polygons([shapely.box(0, 0, 8, 0.2)], extent=shapely.box(0, 0, 8, 6))
    problem = hpop.Problem(world, hpop.DifferentialDrive(), (1, 1, 0), (1.6, 1, None), ["turns", "length"])
    ways = [hpop.Trajectory.from_poses(problem.model, poses) for poses in ([(1, 1, 0), (1.6, 1, 0)], [(1, 1, 0)])]
    place = tmp_path_factory.mktemp("room")
    hpop.Front.of(
        [[0.0, 0.6], [1.0, 0.0]], ways, names=["turns", "length"], units=["1", "m"], problem=problem.describe()
    ).save(place / "front.json")
    return place


def test_a_video_of_the_row_that_is_asked_for(run: Run, folder: Path, tmp_path: Path) -> None:
    result = run("ride", folder, "--video", tmp_path / "it.mp4", "--rows", "least turns", "--fps", "4", "--width", "64")
    assert result.exit_code == 0, result.output
    assert "least turns (row 0) as executed, 64 x 32 pixels, 4 frames a second" in " ".join(result.output.split())
    assert "note: obstacles without an upper end are drawn 3 m high" in result.output
    assert json.loads((tmp_path / "it.mp4.json").read_text())["row"] == 0
    assert (tmp_path / "it.mp4").stat().st_size > 1000


def test_frames_alone(run: Run, folder: Path, tmp_path: Path) -> None:
    result = run("ride", folder, "--frames", tmp_path / "it", "--rows", "1", "--fps", "1", "--width", "64")
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in (tmp_path / "it").iterdir()) == ["frame_00000.png", "frames.json"]


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--video", "it.mp4", "--rows", "7"], None, "the front has rows 0 to 1"),
        (["--video", "it.mp4", "--rows", "0,1"], 2, "a video shows one row, got 2: 0, 1"),
        (["--video", "it.mp4", "--rows", "best"], None, "no row is called 'best'"),
        (["--video", "it.avi"], None, "a file name that ends in .mp4"),
        (["--video", "it.mp4", "--width", "65"], None, "multiple of 4, got 65; 64 is one"),
        (["--video", "it.mp4", "--fps", "0"], None, "frames a second from 1 to 240"),
        (["--video", "it.mp4", "--rows", ","], 2, "expected ROW or ROW,ROW"),
    ],
)
def test_what_cannot_be_is_told(
    run: Run, folder: Path, tmp_path: Path, arguments: list[str], code: int | None, said: str
) -> None:
    arguments = [str(tmp_path / text) if text.startswith("it.") else text for text in arguments]
    result = run("ride", folder, *arguments)
    assert result.exit_code == code if code else result.exit_code > 2
    assert said in " ".join(result.output.split())
    assert not list(tmp_path.iterdir())


def test_a_folder_without_a_front_is_told(run: Run, tmp_path: Path) -> None:
    result = run("ride", tmp_path, "--video", tmp_path / "it.mp4")
    assert result.exit_code > 2
    assert "give the folder that `hpop plan` wrote" in result.output
