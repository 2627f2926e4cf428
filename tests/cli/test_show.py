"""`hpop show`: a front that is not what it claims to be is found out, and never said to be verified."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import Result

import hpop
from hpop.problems.front import Front
from hpop.scenario import load_scenario
from tests.worlds import TWO_WALLS


def edited(path: Path, change: Callable[[dict], object]) -> None:
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))


def moved(data: dict, name: str, by: float) -> None:
    """Shift one state along all trajectories."""
    states = data["items"]["states"]
    states[name] = [value + by for value in states[name]]


@pytest.fixture(scope="module")
def front(
    tmp_path_factory: pytest.TempPathFactory, write_map: Callable[..., None], write: Callable[..., None]
) -> Front:
    folder = tmp_path_factory.mktemp("planned")
    write_map(folder)
    write(folder)
    scenario = load_scenario(folder / "room.yaml")
    return scenario.problem.solve(scenario.planners)


@pytest.fixture
def saved(front: Front, tmp_path: Path) -> Path:
    (tmp_path / "out").mkdir()
    front.save(tmp_path / "out" / "front.json")
    return tmp_path / "out" / "front.json"


def test_only_arms_are_checked_by_coal(saved: Path, run: Callable[..., Result]) -> None:
    result = run("show", saved.parent, "--judge", "coal")
    assert result.exit_code == 9
    assert "only arms are judged by 'coal', but the model is a differential_drive; judge by fcl" in " ".join(
        result.stderr.split()
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda d: d["points"]["costs"]["length"].__setitem__(0, d["points"]["costs"]["length"][0] - 0.5),
            "length is saved as",
        ),
        (lambda d: moved(d, "y", 0.05), "does not begin at the start"),
        (lambda d: moved(d, "x", 1e12), "leaves the map"),
        (lambda d: moved(d, "yaw", 0.5), "goes sideways or backwards"),
        (lambda d: d["items"]["states"]["y"].__setitem__(0, 0.7), "turn must not change y"),
        (lambda d: d["criteria"][1].__setitem__("unit", "km"), "km"),
        (lambda d: d["problem"].__setitem__("goal", [0.5, 1.0, 0.0]), "from the goal"),
    ],
)
def test_a_front_edited_by_hand_is_found_out(
    run: Callable[..., Result], saved: Path, change: Callable[[dict], object], said: str
) -> None:
    edited(saved, change)
    result = run("show", saved)
    assert result.exit_code == 12
    assert said in result.stderr
    assert "plan again" in result.stderr
    assert "verified" not in result.stdout
    if "knee" in result.stdout:  # what is wrong is not shown as if it were right
        assert result.stdout.index("not yet checked") < result.stdout.index("knee")


def test_the_table_comes_first_and_says_that_it_is_not_checked_yet(run: Callable[..., Result], saved: Path) -> None:
    said = run("show", saved).stdout
    assert said.index("not yet checked") < said.index("knee") < said.index("checking") < said.index("verified")


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda d: d.pop("status"), 12),
        (lambda d: d.update(version=99), 12),
        (lambda d: d.update(schema="other"), 12),
        (lambda d: d.update(problem=None), 12),
        (lambda d: d["problem"].update(model=5), 12),
        (lambda d: d["problem"].update(model={"differential_drive": 5}), 12),
        (lambda d: d["problem"].update(model={"differential_drive": {"radius": "wide"}}), 12),
        (lambda d: d["problem"].update(criteria=5), 8),
        (lambda d: d["problem"].update(criteria=[{"turns": 5}]), 8),
        (lambda d: d["problem"].update(criteria=["turnz"]), 7),
        (lambda d: d["problem"].update(start="here"), 5),
        (lambda d: d["problem"].pop("goal"), 5),
        (lambda d: d["problem"].update(world=[]), 3),
        (lambda d: d.update(items=[1, 2]), 12),
        (lambda d: d["items"].update(kinds=["fly"]), 12),
        (lambda d: d["items"]["states"].update(x=[0.0]), 12),
        (lambda d: [column.append(column[-1]) for column in d["items"]["trajectories"].values()], 12),
        (lambda d: d["criteria"][0].update(name="[/bold]"), 12),
        (lambda d: d["runs"].append({"notes": 5, "planner": "[/red]"}), 0),
    ],
)
def test_a_front_that_is_no_front_is_refused_without_a_traceback(
    run: Callable[..., Result], saved: Path, change: Callable[[dict], object], code: int
) -> None:
    edited(saved, change)
    result = run("show", saved.parent)
    assert result.exit_code == code
    assert result.stderr.startswith(("error: ", "fault: ") if code else "")


@pytest.mark.parametrize("content", [b"", b"{", b"[" * 100_000, b"null", b'{"schema": NaN}', b"\xff\xfe"])
def test_a_file_that_is_no_json_is_refused(
    run: Callable[..., Result], refused: Callable[..., None], tmp_path: Path, content: bytes
) -> None:
    (tmp_path / "front.json").write_bytes(content)
    refused(run("show", tmp_path), 12, "front.json")


def test_showing_what_is_not_there(run: Callable[..., Result], refused: Callable[..., None], tmp_path: Path) -> None:
    refused(run("show", tmp_path), 12, f"{tmp_path / 'front.json'}: No such file", "the folder that `hpop plan` wrote")
    refused(run("show", tmp_path / "gone"), 12, "No such file")
    (tmp_path / "flat").mkdir()
    (tmp_path / "flat" / "front.json").touch()
    (tmp_path / "flat" / "front.html").touch()
    refused(run("show", tmp_path / "flta"), 12, f"Did you mean '{tmp_path / 'flat'}'?")
    refused(run("show", tmp_path), 12, f"the folder that `hpop plan` wrote, such as {tmp_path / 'flat'}")
    refused(run("show", tmp_path / "flat" / "front.html"), 12, "got a file in it", f"give {tmp_path / 'flat'}")


def test_showing_a_scenario_names_the_folder_of_its_front(
    run: Callable[..., Result], refused: Callable[..., None], room: Path
) -> None:
    refused(run("show", room / "room.yaml"), 12, "is a scenario; give its folder, such as out/room")


def test_a_map_that_changed_since_the_front_was_saved(
    run: Callable[..., Result],
    refused: Callable[..., None],
    write_map: Callable[..., None],
    front: Front,
    room: Path,
) -> None:
    write_map(room, door=1.2)
    world = {**(front.problem or {})["world"], "path": str(room / "map.yaml")}
    replace(front, problem={**(front.problem or {}), "world": world}).save(room / "front.json")
    refused(run("show", room / "front.json"), 3, "has changed since the result that refers to it")


def test_a_huge_front_is_checked_in_part_and_says_so(
    run: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "walls.yaml").write_text(TWO_WALLS)
    scenario = load_scenario(tmp_path / "walls.yaml")
    front, saved = scenario.problem.solve(scenario.planners), tmp_path / "front.json"
    front.save(saved)
    monkeypatch.setattr("hpop.cli.saved.MOST_CHECKED", 2)
    named = {point.index for point in front.named().values()}
    checked = sorted({0, len(front) - 1} | named)
    left_out = min({*range(len(front))} - {*checked})
    said = run("show", saved, "--rows", 1).stdout
    assert f"{len(named)} of {len(front)} trajectories shown" in said
    assert f"checked for {len(checked)} of {len(front)} trajectories\n" in said
    assert "note: checked were the table and trajectories spread over the front; --all checks all" in said

    edited(saved, lambda d: moved_cost(d, left_out, 1e-7))
    assert "verified" in run("show", saved, "--rows", 1).stdout
    every = run("show", saved, "--all")
    assert f"trajectory {left_out}: {front.names[0]} is saved as" in every.stderr
    edited(saved, lambda d: moved_cost(d, checked[-1], 1e-7))
    assert f"trajectory {checked[-1]}: {front.names[0]} is saved as" in run("show", saved, "--rows", 1).stderr


def moved_cost(data: dict, row: int, by: float) -> None:
    """Change the first cost of one trajectory."""
    column = data["points"]["costs"][data["criteria"][0]["name"]]
    column[row] += by


def test_a_few_points_stand_for_the_front_in_plans_tables_and_exports(
    run: Callable[..., Result], no_pictures: None, tmp_path: Path
) -> None:
    museum = Path(__file__).parents[2] / "examples" / "museum.geojson"
    (tmp_path / "tour.yaml").write_text(
        f"world: {{geojson: {{path: {museum}}}}}\nmodel: {{differential_drive: {{radius: 0.3}}}}\nstart: [2, 10, 0]\n"
        "goal: [28, 10, 0]\ncriteria: [exposure, turns, length]\nplanner: {lattice: {step: 1.0}}\n"
    )
    run("plan", tmp_path / "tour.yaml", "--out", tmp_path / "all")
    said = run("plan", tmp_path / "tour.yaml", "--out", tmp_path / "few", "--points", 3).output
    whole, few = (Front.load(tmp_path / name / "front.json") for name in ("all", "few"))
    rows = hpop.frontier.representative(whole.integers, 3).tolist()
    assert len(whole) > 8
    assert few.costs.tolist() == whole.costs[rows].tolist()
    assert f"selected from {len(whole)} points" in " ".join(said.split())
    marked = {point.index for point in whole.named().values()}
    shown = " ".join(run("show", tmp_path / "all", "--points", 3).output.split())
    assert f"{len(marked | set(rows))} of {len(whole)} trajectories shown, marked or with the largest joint" in shown
    written = run("export", tmp_path / "all", "--points", 3, "--format", "tum").output
    assert [f"row_{row}.tum" in written for row in rows] == [True] * 3
    assert "--rows or --points, not both" in run("show", tmp_path / "all", "--points", 2, "--rows", 3).stderr


def test_a_planner_has_no_number_of_points_and_says_where_to_give_it() -> None:
    with pytest.raises(
        hpop.errors.OptionError, match=r"no option 'max_points'.*; choose among .* hpop plan --points 20"
    ):
        hpop.planners.make_planner({"lattice": {"max_points": 20}})
