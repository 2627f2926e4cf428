"""`hpop look` and `hpop new`: from a map, with nothing else, to a scenario that plans."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml
from click.testing import Result
from PIL import Image

from hpop.problems.front import Front
from hpop.scenario import load_scenario
from hpop.scenario.new import SCHEMA

pytestmark = pytest.mark.usefixtures("no_pictures")


def _image(folder: Path) -> Path:
    """Write a picture of 8 x 6 m at 0.05 m a pixel: a building with two rooms and a door."""
    pixels = np.full((120, 160), 255, dtype=np.uint8)
    pixels[[10, 110], 10:151] = 0
    pixels[10:111, [10, 80, 150]] = 0
    pixels[50:70, 80] = 255
    Image.fromarray(pixels).save(folder / "plan.png")
    return folder / "plan.png"


def _geojson(folder: Path) -> Path:
    rings = {"hall": [(0, 0), (9, 0), (9, 6), (0, 6)], "case": [(4, 0), (5, 0), (5, 4), (4, 4)]}
    features = [
        {
            "type": "Feature",
            "properties": {"name": name},
            "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]]]},
        }
        for name, ring in rings.items()
    ]
    (folder / "hall.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return folder / "hall.geojson"


def _movingai(folder: Path) -> Path:
    rows = ["." * 20, "." * 20, "." * 8 + "@@@@" + "." * 8, "." * 20, "." * 20]
    (folder / "grid.map").write_text("type octile\nheight 5\nwidth 20\nmap\n" + "\n".join(rows) + "\n")
    return folder / "grid.map"


def _ros(folder: Path, write_map: Callable[..., None]) -> Path:
    write_map(folder)
    return folder / "map.yaml"


@pytest.mark.cases("ros-options3")
@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("image", ["--resolution", "0.05"]),
        ("geojson", ["--set", "polygons=outline"]),
        ("movingai", ["--resolution", "0.5"]),
        ("ros", ["--radius", "0.2"]),
    ],
)
def test_a_new_scenario_of_any_map_plans_as_it_is(
    run: Callable[..., Result],
    write_map: Callable[..., None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    kind: str,
    options: list[str],
) -> None:
    makers = {"image": _image, "geojson": _geojson, "movingai": _movingai}
    path = _ros(tmp_path, write_map) if kind == "ros" else makers[kind](tmp_path)
    monkeypatch.chdir(tmp_path)
    written = run("new", path, *options)
    assert written.exit_code == 0, written.output
    scenario = tmp_path / f"{path.stem}_scenario.yaml"
    text = scenario.read_text()
    assert text.startswith(f"# yaml-language-server: $schema={SCHEMA}\n")
    jsonschema.validate(yaml.safe_load(text), json.loads((tmp_path / SCHEMA).read_text()), jsonschema.Draft7Validator)
    assert text.count("# ") > 10
    planned = run("plan", scenario, "--out", tmp_path / "out")
    assert planned.exit_code == 0, planned.output
    assert len(Front.load(tmp_path / "out" / "front.json"))
    again = run("new", path, *options)
    assert (again.exit_code, " exists; remove it" in again.stderr) == (12, True)


def test_the_step_is_so_small_that_a_narrow_door_is_found(
    run: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A robot of 0.6 m and a door of 0.7 m, whose middle lies between the positions of a coarser lattice."""
    pixels = np.full((120, 160), 255, dtype=np.uint8)
    pixels[[0, 119]] = pixels[:, [0, 159]] = 0
    pixels[:, 80] = 0
    pixels[51:65, 80] = 255
    Image.fromarray(pixels).save(tmp_path / "plan.png")
    monkeypatch.chdir(tmp_path)
    ends = ["--start", "2,1.5", "--goal", "6,4.5"]  # its middle may be at y 3.05 to 3.15
    written = run("new", "plan.png", "--resolution", "0.05", *ends)
    assert written.exit_code == 0, written.output
    assert yaml.safe_load(Path("plan_scenario.yaml").read_text())["planner"]["lattice"]["step"] < 0.25
    assert run("plan", "plan_scenario.yaml", "--out", "out").exit_code == 0


def _slot(folder: Path) -> Path:
    """Two rooms and a slot of 0.62 m through a wall of 0.4 m: its middle, at y = 1.83, is no row of the lattices.

    From a start at y = 1 these have rows at 1.8125 and 1.875, 2 and 5 cm away; the robot has 1 cm to either side.
    """
    pixels = np.full((150, 250), 255, dtype=np.uint8)  # 5 x 3 m, row 0 at the top
    pixels[[0, 149]] = pixels[:, [0, 249]] = 0
    pixels[:, 140:160] = 0
    pixels[150 - 107 : 150 - 76, 140:160] = 255  # y from 1.52 to 2.14
    Image.fromarray(pixels).save(folder / "slot.png")
    return folder / "slot.png"


def test_a_goal_that_no_lattice_reaches_is_not_chosen(
    run: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    written = run("new", _slot(tmp_path), "--resolution", "0.02", "--start", "1,1")
    assert written.exit_code == 0, written.output
    scenario = load_scenario(tmp_path / "slot_scenario.yaml")
    assert scenario.problem.goals[0][0] < 2.5
    assert len(scenario.problem.solve(scenario.planners))


def test_where_no_path_is_found_new_says_so_and_writes_what_was_asked_for(
    run: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    written = run("new", _slot(tmp_path), "--resolution", "0.02", "--start", "1,1", "--goal", "4,2")
    assert written.exit_code == 6
    assert "no path was found from the start to the goal: the widest passage" in written.stderr
    assert "move start or goal (--start, --goal), or take a smaller robot (--radius)" in written.stderr
    assert "hpop plan" not in written.output
    assert load_scenario(tmp_path / "slot_scenario.yaml").problem.goals == ((4.0, 2.0, None),)


def test_names_are_quoted_where_commands_are_printed(
    run: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    _image(tmp_path).rename(tmp_path / "it's the ground floor.png")
    written = run("new", "it's the ground floor.png", "--resolution", "0.05")
    text = (tmp_path / "it's the ground floor_scenario.yaml").read_text()
    for said in (written.stdout.rpartition("next: ")[2], text.partition("Look at it: ")[2].partition("\n")[0]):
        words = shlex.split(said.replace(", then", ""))
        assert words[:3] == ["hpop", "look", "it's the ground floor_scenario.yaml"]
        assert words[-2:] == ["--out", "out/it's the ground floor_scenario"]


def test_a_picture_is_called_as_its_map_and_no_way_has_its_own_exit_code(
    run: Callable[..., Result], write: Callable[..., None], room: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    hall = _geojson(tmp_path)
    assert run("look", hall, "--set", "polygons=outline").exit_code == 0
    assert (tmp_path / "hall_look.png").exists()
    assert "written to hall_look.png (replaced)" in run("look", hall, "--set", "polygons=outline").stdout
    wall = {"corners": [[4, 0], [5, 0], [5, 6], [4, 6]]}
    world = {"polygons": {"extent": [[0, 0], [9, 0], [9, 6], [0, 6]], "obstacles": [wall]}}
    asked = {"world": world, "start": [2, 2, 0], "goal": [7, 2, 0], "criteria": ["length"]}
    (tmp_path / "apart.yaml").write_text(json.dumps(asked))
    result = run("look", "apart.yaml")
    assert result.exit_code == 6, result.output
    assert "no path seems to lead from the start to" in result.stderr
    assert (tmp_path / "apart_look.png").exists()
    (tmp_path / "apart.yaml").write_text(json.dumps({**asked, "goal": [[7, 2, 0], [2, 4, 0]]}))
    assert run("look", "apart.yaml").exit_code == 0  # one of two goals can be reached


def test_start_and_goal_are_indoors_or_as_asked_for(
    run: Callable[..., Result], refused: Callable[..., None], tmp_path: Path
) -> None:
    path, out = _image(tmp_path), tmp_path / "scenarios" / "mine.yaml"
    asked = ["new", path, "--resolution", "0.05", "--out", out]
    assert run(*asked).exit_code == 0
    problem = load_scenario(out).problem
    assert 0.5 < problem.start[0] < 4.0 < problem.goals[0][0] < 7.5
    assert "path: ../plan.png" in out.read_text()
    out.unlink()
    assert run(*asked, "--start", "6,2,90 deg", "--goal", "1.5,4").exit_code == 0
    problem = load_scenario(out).problem
    assert problem.start == pytest.approx((6.0, 2.0, np.pi / 2))
    assert problem.goals == ((1.5, 4.0, None),)
    out.unlink()
    refused(
        run(*asked, "--goal", "4.02,1"), 5, "the goal is not usable", "The nearest place where the robot is free is ("
    )
    refused(run(*asked, "--start", "6;2"), 10, "expected --start X,Y in m")
    assert not out.exists()


def test_an_option_that_a_note_proposes_is_told_as_it_is_typed(run: Callable[..., Result], tmp_path: Path) -> None:
    image, out = _image(tmp_path), ["--out", tmp_path / "x.png", "--resolution", "0.05"]
    pixels = np.array(Image.open(image))
    pixels[70:100, 20:50] = 160  # a grey table
    Image.fromarray(pixels).save(image)
    noted = run("look", image, *out).stdout
    assert "give threshold: 0.64. Here: --set threshold=0.64\n" in noted
    assert "0 are free" in run("look", image, *out, "--set", "threshold=0.64").stdout


def test_what_lacks_or_is_strange_is_told(
    run: Callable[..., Result], refused: Callable[..., None], tmp_path: Path, write_map: Callable[..., None]
) -> None:
    image, hall, out = _image(tmp_path), _geojson(tmp_path), ["--out", tmp_path / "x.png"]
    refused(run("look", image, *out), 10, "give --resolution, metres per pixel")
    refused(run("look", image, "--resolution", "0.001", *out), 3, "free nowhere on this map of 0.16 x 0.12 m")
    image.with_suffix(".yaml").touch()
    refused(run("look", image, *out), 10, "or give", f"{image.stem}.yaml, which states it")
    refused(run("look", hall, *out), 3, "feature 0 'hall' contains all else", "--set polygons=outline")
    refused(run("look", hall, "--set", "polygon=outline", *out), 3, "Did you mean 'polygons'?", "--set")
    assert run("look", hall, "--set", "outline", *out).exit_code == 2
    refused(run("look", _ros(tmp_path, write_map), "--resolution", "0.1", *out), 10, "takes no --resolution")
    refused(
        run("look", image, "--resolution", "0.05", "--out", image), 12, "expected another name than that of the map"
    )
    (tmp_path / "empty").mkdir()
    refused(run("new", tmp_path / "empty"), 3, "is a folder; give the path of a map, an image.")
    folder = run("look", tmp_path)
    refused(folder, 3, "is a folder; give the path of a map, such as ", "hall.geojson")
    assert "bag" not in folder.stderr
    refused(run("look", tmp_path / "gone.yaml", *out), 4, "no such file")
    refused(run("look", tmp_path / "gone.png", *out), 3, "no such file")
    refused(run("look", tmp_path / "plam.png", *out), 3, f"Did you mean '{tmp_path / 'plan.png'}'?")
    (tmp_path / "hall_scenario.yaml").touch()
    refused(run("plan", tmp_path / "hall_scenaro.yml"), 4, f"Did you mean '{tmp_path / 'hall_scenario.yaml'}'?")
    refused(
        run("new", image, "--resolution", "0.05", "--set", "threshold=x", *out),
        3,
        "got 'x'. Set options of the reader by --set",
    )
    misnamed = run("new", image, "--resolution", "0.05", "--set", "treshold=0.8", *out)
    refused(misnamed, 3, "Did you mean 'threshold'? Its options are", "such as --set threshold=VALUE.")
    (tmp_path / "lost.yaml").write_text("image: gone.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
                                        "occupied_thresh: 0.65\nfree_thresh: 0.2\n")  # fmt: skip
    lost = run("new", tmp_path / "lost.yaml", *out)
    refused(lost, 3, "gone.pgm' cannot be opened: No such file or directory. Check the path.")
    assert "--set" not in lost.stderr
    (tmp_path / "plan.xyz").touch()
    refused(run("new", tmp_path / "plan.xyz"), 3, "no reader is known for this ending")


def test_a_look_at_a_scenario_draws_it_and_tells_of_ends_that_cannot_be_used(
    run: Callable[..., Result], refused: Callable[..., None], write: Callable[..., None], room: Path
) -> None:
    out = room / "pictures" / "look.png"
    result = run("look", room / "room.yaml", "--out", out)
    assert result.exit_code == 0, result.output
    assert "note: the robot is free on " in result.stdout
    with Image.open(out) as picture:
        assert min(picture.size) > 500
    assert run("look", room / "room.yaml", "--radius", "1").exit_code == 2
    out.unlink()
    write(room, ("[0.5, 0.5, 0]", "[2.0, 0.5, 0]"))
    refused(
        run("look", room / "room.yaml", "--out", out), 5, "the start (2, 0.5) is not usable: it is inside an obstacle"
    )
    assert out.exists()  # it shows where


@pytest.mark.parametrize("name", ["look", "look.jpg"])
def test_a_look_whose_file_is_no_png_by_its_name_is_refused(
    run: Callable[..., Result], refused: Callable[..., None], room: Path, name: str
) -> None:
    refused(run("look", room / "room.yaml", "--out", room / name), 12, "--out: expected a name that ends in .png, got")
    assert not (room / name).exists()


def test_a_new_scenario_of_a_scenario_is_refused_with_what_to_do(
    run: Callable[..., Result], refused: Callable[..., None], room: Path, tmp_path: Path
) -> None:
    result = run("new", room / "room.yaml", "--out", tmp_path / "z.yaml")
    refused(result, 10, "room.yaml is a scenario already: hpop look")


def test_a_look_at_a_map_needs_nothing_else(run: Callable[..., Result], tmp_path: Path) -> None:
    result = run("look", _image(tmp_path), "--resolution", "0.05", "--radius", "0.2", "--out", tmp_path / "look.png")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "look.png").exists()
    assert "in 2 parts between which it cannot go" in result.stdout


ARM = Path(__file__).parents[2] / "examples" / "arm"


def test_look_writes_the_page_of_a_urdf_and_says_which_tip_it_took(
    run: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run(
        "look", ARM / "arm6.urdf", "--set", f"srdf={ARM / 'arm6.srdf'}", "--set", "camera=[0, 0, 0.1, 0, 0, 0]"
    )
    assert result.exit_code == 0, result.output
    assert "note: the tip is camera, at the end of the most joints" in result.output
    (payload,) = re.findall(r'id="payload">(.*?)</script>', (tmp_path / "arm6_look.html").read_text())
    page = json.loads(payload)
    assert [state["name"] for state in page["states"]] == ["home", "ready", "upright", "all 0"]
    apart = np.array(page["camera"]["pose"])[:, 3] - np.array(page["tool"]["pose"])[:, 3]
    assert np.linalg.norm(apart) == pytest.approx(0.1)

    result = run("look", ARM / "arm6.urdf", "--set", "tip=forearm", "--out", tmp_path / "some.html")
    assert result.exit_code == 0, result.output
    (payload,) = re.findall(r'id="payload">(.*?)</script>', (tmp_path / "some.html").read_text())
    assert len(json.loads(payload)["joints"]) == 4
    for wrong, code in ((["--set", "tip=nose"], 9), (["--set", "fixed={"], 10), (["--out", "arm.png"], 10)):
        assert run("look", ARM / "arm6.urdf", *wrong).exit_code == code


def test_look_writes_the_page_of_an_arms_scenario_and_refuses_it_for_a_base(
    run: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The arm touches the table at its start: an error says so, and the page is written all the same."""
    monkeypatch.chdir(tmp_path)
    scenario = yaml.safe_load((ARM.parent / "arm_shelf.yaml").read_text())
    scenario["model"]["serial_arm"] |= {"urdf": str(ARM / "arm6.urdf"), "srdf": str(ARM / "arm6.srdf")}
    scenario["start"] = [0.3, 0.8, 0.9, 0, 0, 0]
    (tmp_path / "blocked.yaml").write_text(yaml.safe_dump(scenario))
    result = run("look", "blocked.yaml", "--web")
    assert result.exit_code == 5
    assert "the start is not usable: the link 'hand' touches the obstacle" in " ".join(result.stderr.split())
    (payload,) = re.findall(r'id="payload">(.*?)</script>', (tmp_path / "blocked_look.html").read_text())
    assert json.loads(payload)["states"][0] == {"name": "start", "values": scenario["start"]}
    result = run("look", ARM.parent / "museum.geojson", "--web")
    assert result.exit_code == 9
    assert "this page shows an arm: a serial_arm, a mobile_arm or two_arms" in " ".join(result.stderr.split())
