"""Fixtures of the command line: a room with a map and a scenario, and ways to run commands on it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner, Result

import hpop.view
from hpop.cli import main
from hpop.cli.beside import PicturesBeside
from hpop.scenario import load_scenario
from hpop.view import save

ROOM = """\
world:
  ros_map: {path: map.yaml}
model:
  differential_drive: {radius: 0.2}
start: [0.5, 0.5, 0]
goal: [3.5, 0.5, 0]
criteria: [turns, length]
planner:
  lattice: {step: 0.5}
"""
MAP = {
    "image": "map.pgm",
    "resolution": 0.1,
    "origin": [0, 0, 0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.2,
}


@pytest.fixture(scope="session")
def write_map() -> Callable[..., None]:
    def write_map(folder: Path, door: float = 1.0, **keys: object) -> None:
        """Write the map of a room of 4 x 2 m with a wall in the middle; its door (m wide) is at the top."""
        pixels = np.full((20, 40), 255, dtype=np.uint8)
        pixels[round(10 * door) :, 19:21] = 0
        (folder / "map.pgm").write_bytes(b"P5\n40 20\n255\n" + pixels.tobytes())
        (folder / "map.yaml").write_text(yaml.safe_dump(MAP | keys))

    return write_map


@pytest.fixture(scope="session")
def write() -> Callable[..., None]:
    def write(folder: Path, *changes: tuple[str, str]) -> None:
        """Write the scenario, with some of its text replaced."""
        text = ROOM
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (folder / "room.yaml").write_text(text)

    return write


@pytest.fixture
def room(tmp_path: Path, write_map: Callable[..., None], write: Callable[..., None]) -> Path:
    """Folder with a map and a scenario that has a front."""
    write_map(tmp_path)
    write(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def folder(
    tmp_path_factory: pytest.TempPathFactory, write_map: Callable[..., None], write: Callable[..., None]
) -> Path:
    """Return a folder with the front of a room."""
    place = tmp_path_factory.mktemp("room")
    write_map(place)
    write(place)
    scenario = load_scenario(place / "room.yaml")
    (place / "out").mkdir()
    scenario.problem.solve(scenario.planners).save(place / "out/front.json")
    return place / "out"


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give pictures few pixels, where a command draws them itself."""
    monkeypatch.setattr(hpop.view, "save_pictures", partial(hpop.view.save_pictures, dpi=40))
    monkeypatch.setattr(save, "_png", lambda figure, dpi, png=save._png: png(figure, min(dpi, 90)))


@pytest.fixture
def no_pictures(coarse: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures and the page are tested elsewhere; pictures take a second each."""
    monkeypatch.setattr(hpop.view, "save_pictures", lambda problem, front, folder, **options: [])
    monkeypatch.setattr(hpop.view, "save_explorer", lambda problem, front, path, **options: Path(path))
    monkeypatch.setattr(PicturesBeside, "_begin", lambda pictures, which: None)


@pytest.fixture(scope="session")
def run() -> Callable[..., Result]:
    def run(*arguments: object, typed: str | None = None) -> Result:
        """Run a command, to which something may be typed; it may fail, but never with a traceback."""
        result = CliRunner().invoke(main, [str(argument) for argument in arguments], typed)
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        assert "Traceback" not in result.output
        return result

    return run


@pytest.fixture(scope="session")
def plan(run: Callable[..., Result]) -> Callable[..., Result]:
    return lambda folder: run("plan", folder / "room.yaml", "--out", folder / "out")


@pytest.fixture(scope="session")
def refused() -> Callable[..., None]:
    def refused(result: Result, code: int, *said: str) -> None:
        """Check that a command ended with this exit code and wrote all these texts to standard error."""
        assert (result.exit_code, [text for text in said if text not in result.stderr]) == (code, []), result.stderr
        assert result.stderr.startswith("error: ")

    return refused
