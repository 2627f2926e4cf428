"""Nothing that hpop writes to be shared holds a whole path, and so the name of a user's folder."""

from __future__ import annotations

import base64
import gzip
import io
import json
import re
import shutil
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

import hpop
from hpop import study
from hpop.cli import main
from hpop.world.files import by_names
from tests.study import sessions

WHO = "zz_username_zz"
SPELT = (WHO.encode(), WHO.encode("utf-16-le"), WHO.encode("utf-16-be"))
SCENARIO = """\
world:
  image: {{path: {plan}, resolution: 0.05}}
people:
  - {{track: {tracks}}}
model:
  differential_drive: {{radius: 0.2}}
start: [0.5, 2, 0]
goal: [4.5, 2, any]
criteria: [exposure, turns, length]
planner:
  lattice: {{step: 0.5}}
"""


def contents(data: bytes, depth: int = 0) -> Iterator[bytes]:
    """Bytes, and what is packed in them: gzip, zip, zlib, deflated streams of PNG and PDF, base64."""
    yield data
    if depth > 3:
        return
    if data[:2] == b"\x1f\x8b":
        yield from contents(gzip.decompress(data), depth + 1)
    if data[:2] in (b"x\x01", b"x\x5e", b"x\x9c", b"x\xda"):
        yield from contents(zlib.decompressobj().decompress(data, 100_000_000), depth + 1)
    if data[:4] == b"PK\x03\x04":
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            for name in archive.namelist():
                yield name.encode()
                yield from contents(archive.read(name), depth + 1)
    if data[:4] in (b"\x89PNG", b"%PDF"):
        for begin in re.finditer(rb"x[\x01\x5e\x9c\xda]", data):
            try:
                yield zlib.decompressobj().decompress(data[begin.start() :], 10_000_000)
            except zlib.error:
                continue
    for text in re.finditer(rb"[A-Za-z0-9+/]{40,}", data):
        packed = text.group()
        yield from contents(base64.b64decode(packed[: len(packed) // 4 * 4]), depth + 1)


def telling(folder: Path, given: set[Path]) -> dict[str, bytes]:
    """Return the new files in a folder that hold the user's name, with the text about it."""
    found: dict[str, bytes] = {}
    for path in folder.rglob("*"):
        if path.is_file() and path not in given:
            for part in contents(path.read_bytes()):
                for name in SPELT:
                    if (place := part.find(name)) >= 0:
                        found[str(path.relative_to(folder))] = part[max(0, place - 80) : place + 80]
    return found


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a user's folder with a map and a track; hpop writes a note about both."""
    home = tmp_path / WHO
    home.mkdir()
    for name in ("USER", "LOGNAME", "USERNAME"):
        monkeypatch.setenv(name, WHO)
    pixels = np.full((80, 100, 4), 255, dtype=np.uint8)
    pixels[20:60, 40:60, :3] = 0
    pixels[0, 0, :3] = 128  # neither dark nor light: noted
    Image.fromarray(pixels, "RGBA").save(home / "plan.png")
    rows = [f"{t},1,{0.5 + 0.01 * t},0.2" for t in range(3)] + ["9,1,0.6,0.2", "0,2,1,0.2"]
    (home / "tracks.csv").write_text("t,id,x,y\n" + "\n".join(rows))
    (home / "consent.txt").write_text("I agree.")
    (home / "events.yaml").write_text("events:\n  - {at: 0.5, options: true}\n")
    return home


def run(*words: str | Path, answers: str | None = None) -> str:
    result = CliRunner().invoke(main, [str(word) for word in words], input=answers)
    assert result.exit_code == 0, result.output
    return result.output


@pytest.mark.proof
@pytest.mark.parametrize("whole", [False, True])
def test_nothing_that_is_written_tells_the_folder_of_a_user(
    home: Path, whole: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(home.parent if whole else home)
    where = home if whole else Path()
    (home / "room.yaml").write_text(SCENARIO.format(plan=where / "plan.png", tracks=where / "tracks.csv"))
    given = set(home.iterdir())
    out, studied = where / "out", where / "study"
    run("plan", where / "room.yaml", "--out", out)
    run("show", out, "--web")
    run("look", where / "room.yaml")
    run("new", where / "plan.png", "--resolution", "0.05")
    run("pick", out)
    run("ride", out)
    run("ride", out, "--frames", where / "frames", "--fps", "1", "--width", "64")
    run("prefer", out, answers="a\nb\nstop\n")
    run("drive", out, "--events", where / "events.yaml")
    formats = re.findall(r"^  ([a-z0-9-]+)  ", run("formats"), re.MULTILINE)
    of_joints = {"follow-joint-trajectory", "joint-trajectory", "moveit"}  # this robot has none
    run("export", out, "--format", ",".join(name for name in formats if name not in of_joints))
    run("study", "init", studied, "--front", out, "--rows", "0,1", "--participants", "2", "--consent",
        where / "consent.txt", "--forms", "comfort")  # fmt: skip
    sessions.answered(study.Design.load(home / "study"), home / "study", ["p01", "p02"])
    run("study", "check", studied)
    run("study", "score", studied)
    run("study", "report", studied, "--score", "comfort.comfort")
    front = hpop.Front.load(home / "out" / "front.json")
    drawn = hpop.view.draw_map(hpop.Problem.from_description(front.problem or {}), front)
    for ending in ("pdf", "svg", "png"):
        drawn.savefig(home / f"drawn.{ending}")
    assert telling(home, given) == {}


def test_notes_name_files_and_no_folders(home: Path) -> None:
    """Checked for a map: in a front, in its page, and in a description of bare geometry."""
    world = hpop.World.from_image(home / "plan.png", resolution=0.05)
    assert any(str(home / "plan.png") in note for note in world.notes)
    problem = hpop.Problem(world, hpop.DifferentialDrive(radius=0.2), (0.5, 2, 0), (4.5, 2, None), ["turns", "length"])
    front = problem.solve(step=0.5)
    front.save(home / "front.json")
    hpop.view.save_explorer(problem, front, home / "front.html", saved=home / "front.json")
    (home / "bare.json").write_text(json.dumps(replace(world, ground=world.ground).describe()))
    for name in ("front.html", "bare.json"):
        assert any(b"plan.png: " in part for part in contents((home / name).read_bytes()))
    assert telling(home, {home / "plan.png"}) == {}
    spaced = home / "my plans"
    spaced.mkdir()
    shutil.copy(home / "plan.png", spaced / "a b.png")
    for said in ("{}: 1 pixel.", "the map '{}' is old", "read {}.", "({}, {})", "{}"):
        assert by_names(said.replace("{}", str(spaced / "a b.png"))) == said.replace("{}", "a b.png")
    assert by_names("/map and 2 /s, a/b of /nowhere/x.png") == "/map and 2 /s, a/b of /nowhere/x.png"


def test_what_is_searched_is_found_where_it_is_packed(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.txt", base64.b64encode(gzip.compress(SPELT[0] * 9)))
    picture = Image.new("L", (4, 4))
    picture.save(tmp_path / "a.png")
    assert set(telling(tmp_path, set())) == {"a.zip"}
    shutil.copy(tmp_path / "a.png", tmp_path / f"{WHO}.png")  # by its name alone: not within
    assert set(telling(tmp_path, set())) == {"a.zip"}
