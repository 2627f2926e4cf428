"""Fronts of trajectories: they survive saving, and a file that is none is refused."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria.costs import trajectory_costs
from hpop.errors import MapError
from hpop.frontier import FrontError, FrontFileError
from hpop.problems.problem import Problem


@pytest.fixture(scope="module")
def front() -> hpop.Front:
    world = hpop.World.from_polygons([shapely.box(2, 0, 3, 2.2)], extent=shapely.box(0, 0, 5, 4))
    asked = Problem(
        world, hpop.DifferentialDrive(radius=0.2), (1, 1, 0), (4, 1, None), ["obstruction", "turns", "length"]
    )
    return asked.solve(step=0.5)


def test_a_saved_front_is_the_same_when_loaded(front: hpop.Front, tmp_path: Path) -> None:
    front.save(tmp_path / "front.json")
    again = hpop.Front.load(tmp_path / "front.json")
    assert len(again) > 1
    for name in ("names", "units", "groups", "reported_names", "reported_units", "status", "certificate", "notes"):
        assert getattr(again, name) == getattr(front, name)
    for name in ("provenance", "problem", "runs"):
        assert getattr(again, name) == getattr(front, name)
    for name in ("costs", "reported", "quanta", "integers"):
        assert np.array_equal(getattr(again, name), getattr(front, name))
    for saved, found in zip(again.trajectories, front.trajectories, strict=True):
        assert saved.kinds == found.kinds
        assert saved.model == found.model
        for name in found.states.names:
            assert np.array_equal(getattr(saved.states, name), getattr(found.states, name))


def test_a_loaded_front_united_with_the_first_adds_nothing(front: hpop.Front, tmp_path: Path) -> None:
    front.save(tmp_path / "front.json")
    both = front | hpop.Front.load(tmp_path / "front.json")
    assert isinstance(both, hpop.Front)
    assert np.array_equal(both.costs, front.costs)
    assert both.runs == front.runs


def test_the_saved_problem_gives_the_saved_costs_again(front: hpop.Front, tmp_path: Path) -> None:
    front.save(tmp_path / "front.json")
    again = hpop.Front.load(tmp_path / "front.json")
    problem = Problem.from_description(again.problem or {})
    costs = trajectory_costs(problem.criteria, again.trajectories, problem.world)
    assert [c.name for c in problem.criteria] == ["obstruction", "turns", "length"]
    assert np.array_equal(costs, np.column_stack([again.reported[:, 0], again.costs[:, 1:]]))


def edited(front: hpop.Front, path: Path, key: str, value: Any) -> Path:
    front.save(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))
    return path


MAP = "type octile\nheight 3\nwidth 6\nmap\n......\n..@...\n......\n"


@pytest.fixture
def tour(tmp_path: Path) -> Path:
    """Return a folder with a map and, deeper, the front of a problem on it."""
    (tmp_path / "tour" / "out").mkdir(parents=True)
    (tmp_path / "tour" / "hall.map").write_text(MAP)
    world = hpop.World.from_movingai(tmp_path / "tour" / "hall.map")
    asked = Problem(world, hpop.DifferentialDrive(radius=0.2), (0.5, 0.5, 0), (5.5, 0.5, None), ["turns", "length"])
    asked.solve(step=0.5).save(tmp_path / "tour" / "out" / "front.json")
    return tmp_path / "tour"


def rebuilt(path: Path) -> Problem:
    return Problem.from_description(hpop.Front.load(path).problem or {})


def test_a_front_and_its_map_can_be_moved_together(tour: Path) -> None:
    moved = tour.rename(tour.parent / "elsewhere")
    problem = rebuilt(moved / "out" / "front.json")
    assert problem.world.describe()["path"] == str(moved / "hall.map")
    front = hpop.Front.load(moved / "out" / "front.json")
    assert len(front | problem.solve(step=0.5)) == len(front) > 0


def test_fronts_of_copies_of_a_map_join_and_of_another_map_do_not(tour: Path) -> None:
    copy = Path(shutil.copytree(tour, tour.parent / "copy"))
    here, there = (hpop.Front.load(folder / "out" / "front.json") for folder in (tour, copy))
    assert here.problem != there.problem
    assert len(here | there) == len(here) > 0
    saved = json.loads((copy / "out" / "front.json").read_text())
    saved["problem"]["world"]["sha256"] = ["0" * 64]
    (copy / "out" / "front.json").write_text(json.dumps(saved))
    with pytest.raises(FrontError, match="problems"):
        _ = here | hpop.Front.load(copy / "out" / "front.json")


def test_a_saved_front_names_its_map_as_its_folder_sees_it_and_no_place_of_this_machine(tour: Path) -> None:
    text = (tour / "out" / "front.json").read_text()
    assert json.loads(text)["problem"]["world"]["path"] == "../hall.map"
    assert not any(part in text for part in tour.parts[1:])


def test_a_map_in_the_home_folder_of_a_front_that_is_outside_is_named_without_whose_it_is(
    tour: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    away = tour.parent / "away.json"
    monkeypatch.setenv("HOME", str(tour))
    hpop.Front.load(tour / "out" / "front.json").save(away)
    assert json.loads(away.read_text())["problem"]["world"]["path"] == "~/hall.map"
    assert rebuilt(away).world.describe()["path"] == str(tour / "hall.map")
    monkeypatch.setenv("HOME", str(tour.rename(tour.parent / "ada")))  # of who was given it
    assert rebuilt(away).world.describe()["path"] == str(tour.parent / "ada" / "hall.map")


def test_a_front_that_is_moved_away_finds_its_map_beside_it(tour: Path) -> None:
    (away := tour.parent / "away" / "deeper").mkdir(parents=True)
    moved = (tour / "out" / "front.json").rename(away / "front.json")
    with pytest.raises(
        MapError,
        match=r"map of this front is missing: .*away/hall.map.*Put the unchanged file there, or beside the front",
    ):
        rebuilt(moved)
    shutil.copy(tour / "hall.map", away)
    assert rebuilt(moved).world.describe()["path"] == str(away / "hall.map")


def as_once(path: Path) -> None:
    """Let a front hold whole paths as well, as in files of earlier versions."""
    saved = json.loads(path.read_text())
    world = saved["problem"]["world"]
    for name, seen in world["relative"].items():
        (world if name == "path" else world["options"])[name] = str((path.parent / seen).resolve())
    path.write_text(json.dumps(saved))


def test_a_front_with_whole_paths_can_be_moved_away_from_its_map(tour: Path) -> None:
    as_once(tour / "out" / "front.json")
    moved = (tour / "out" / "front.json").rename(tour.parent / "front.json")
    assert rebuilt(moved).world.describe()["path"] == str(tour / "hall.map")


def test_a_copy_takes_the_map_beside_it_unless_that_changed_and_the_first_one_did_not(tour: Path) -> None:
    as_once(tour / "out" / "front.json")
    copy = Path(shutil.copytree(tour, tour.parent / "copy"))
    assert rebuilt(copy / "out" / "front.json").world.describe()["path"] == str(copy / "hall.map")
    (copy / "hall.map").write_text(MAP.replace("@", "."))
    assert rebuilt(copy / "out" / "front.json").world.describe()["path"] == str(tour / "hall.map")
    (tour / "hall.map").write_text("no map at all")
    for folder in (copy, tour):
        with pytest.raises(MapError, match=rf"{folder.name}/hall.map"):
            rebuilt(folder / "out" / "front.json")
    (copy / "hall.map").write_text(MAP)
    assert rebuilt(copy / "out" / "front.json").world.describe()["path"] == str(copy / "hall.map")
    (tour / "hall.map").unlink()
    (copy / "hall.map").write_text(MAP.replace("@", "."))
    with pytest.raises(MapError, match="changed since the result that refers to it was saved"):
        rebuilt(copy / "out" / "front.json")


def test_a_front_whose_map_is_nowhere_names_both_places_for_it(tour: Path) -> None:
    as_once(tour / "out" / "front.json")
    moved = tour.parent / "far" / "out" / "front.json"
    moved.parent.mkdir(parents=True)
    (tour / "out" / "front.json").rename(moved)
    (tour / "hall.map").rename(tour / "away.map")
    with pytest.raises(MapError, match="the map of this front is missing: it is neither at") as error:
        rebuilt(moved)
    places = [tour / "hall.map", tour.parent / "far" / "hall.map"]
    assert all(repr(str(place)) in str(error.value) for place in places)
    for place in places:
        shutil.copy(tour / "away.map", place)
        assert rebuilt(moved).world.describe()["path"] == str(place)
        place.unlink()


def test_a_front_with_whole_paths_alone_is_read(tour: Path) -> None:
    path = tour / "out" / "front.json"
    as_once(path)
    saved = json.loads(path.read_text())
    del saved["problem"]["world"]["relative"]
    path.write_text(json.dumps(saved))
    assert rebuilt(path).world.describe()["path"] == str(tour / "hall.map")


@pytest.fixture
def masked(tmp_path: Path) -> Path:
    """Return a folder with a ROS map, its mask, and the front of a problem on it."""
    folder = tmp_path / "before"
    folder.mkdir()
    for name in ("map", "mask"):
        (folder / f"{name}.pgm").write_bytes(
            b"P5\n8 8\n255\n" + (b"\xff" * 64 if name == "map" else b"\xff" * 63 + b"\0")
        )
        (folder / f"{name}.yaml").write_text(
            f"image: {name}.pgm\nresolution: 0.5\norigin: [0, 0, 0]\nnegate: 0\n"
            "occupied_thresh: 0.65\nfree_thresh: 0.2\n"
        )
    world = hpop.World.from_ros_map(folder / "map.yaml", keep_out=folder / "mask.yaml")
    asked = Problem(world, hpop.DifferentialDrive(radius=0.2), (1, 1, 0), (3, 1, None), ["length"])
    asked.solve(step=0.5).save(folder / "front.json")
    return folder


def test_a_mask_is_moved_with_its_map(masked: Path) -> None:
    moved = masked.rename(masked.parent / "after")
    world = rebuilt(moved / "front.json").world
    assert world.describe()["options"]["keep_out"] == str(moved / "mask.yaml")
    assert world.keep_out.area == pytest.approx(0.25)


@pytest.mark.parametrize("changed", ["map.pgm", "mask.pgm"])
def test_an_image_that_changed_beside_the_front_is_left_for_the_first_one(masked: Path, changed: str) -> None:
    as_once(masked / "front.json")
    copy = Path(shutil.copytree(masked, masked.parent / "copy"))
    assert rebuilt(copy / "front.json").world.describe()["path"] == str(copy / "map.yaml")
    (copy / changed).write_bytes(b"P5\n8 8\n255\n" + b"\xff" * 63 + b"\x01")
    world = rebuilt(copy / "front.json").world.describe()
    assert (world["path"], world["options"]["keep_out"]) == (str(masked / "map.yaml"), str(masked / "mask.yaml"))


MODELS = [None, [], {}, {"tank": {}}, {"differential_drive": 3}, {"differential_drive": {"radius": "wide"}}]


@pytest.mark.parametrize("problem", [None, {}, *({"model": model} for model in MODELS)])
def test_a_front_without_a_model_cannot_hold_trajectories(front: hpop.Front, tmp_path: Path, problem: object) -> None:
    path = edited(front, tmp_path / "front.json", "problem", problem)
    with pytest.raises(FrontFileError, match=r"expected a front with .*robot model"):
        hpop.Front.load(path)
    front.save(path, encode=hpop.Trajectory.describe, problem=None if problem is None else {})
    items = hpop.Front.load(path, decode=lambda item: item).items
    assert items == tuple(trajectory.describe() for trajectory in front.trajectories)


@pytest.mark.parametrize("notes", [None, 3, "text", {"a": 1}])
def test_notes_that_are_no_list_are_passed_over(front: hpop.Front, tmp_path: Path, notes: object) -> None:
    runs = [{"notes": notes}, {"notes": ["no path", {"odd": []}]}, {}]
    path = edited(front, tmp_path / "front.json", "runs", runs)
    assert hpop.Front.load(path).notes == ("no path", "{'odd': []}")


def test_notes_that_several_runs_share_are_said_once(front: hpop.Front) -> None:
    assert front.notes == tuple(dict.fromkeys(front.runs[0]["notes"]))
    assert any("exposure" in note for note in front.notes)


def test_a_choice_that_leaves_no_point_is_blamed_and_not_the_notes_of_the_search(front: hpop.Front) -> None:
    with pytest.raises(hpop.frontier.FrontError, match="by turns <= -1") as raised:
        front.where(turns="<=-1").knee()
    assert not any(note in str(raised.value) for note in front.notes)


def test_a_front_ends_with_a_status_that_hpop_knows(front: hpop.Front, tmp_path: Path) -> None:
    with pytest.raises(FrontError, match=r"status must be one of complete, no path, .*got 'proven by me'"):
        hpop.Front.of(front.costs, front.trajectories, status="proven by me")
    with pytest.raises(FrontError, match="status must be one of"):
        hpop.Front.load(edited(front, tmp_path / "front.json", "status", "complete\u200b"))
    assert hpop.Front.of(front.costs, front.trajectories, status="complete | time limit").status
