"""Claims: maps are read in parts that ask the limits of whoever plans, and a limit passed meanwhile ends planning."""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from PIL import Image

from hpop.base.registry import readers
from hpop.cli import main
from hpop.errors import LimitError
from hpop.planners.spending import Spending
from hpop.runtime import limits
from hpop.runtime.limits import Budget
from hpop.scenario import load_scenario
from hpop.world import World
from hpop.world.readers import geojson_content
from hpop.world.readers.readers import read_world

SIDE = 40  # cells or polygons along each side of a map
PARTS = 8  # that it is read in, at least


class Stop(Exception):
    pass


@dataclass
class Counted:
    """Limits that count what they are asked, and stop at some question."""

    most: float = float("inf")
    asked: list[str] = field(default_factory=list)
    held: int = 0

    def check(self, doing: str, memory: int = 0) -> None:
        self.asked.append(doing)
        if len(self.asked) >= self.most:
            raise Stop

    def hold(self, memory: int, doing: str) -> None:
        self.held += memory


def polygons(folder: Path) -> Path:
    """Return a file of squares that stand apart, each with a speed limit."""
    features = []
    for i in range(SIDE * SIDE):
        x, y = 3 * (i % SIDE), 3 * (i // SIDE)
        ring = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1], [x, y]]
        shape = {"type": "Polygon", "coordinates": [ring]}
        features.append({"type": "Feature", "properties": {"limit": 1}, "geometry": shape})
    path = folder / "plan.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def image(folder: Path) -> Path:
    path = folder / "plan.png"
    shades = 255 * (np.indices((SIDE, SIDE)).sum(axis=0) % 3 > 0)
    Image.fromarray(shades.astype(np.uint8)).save(path)
    return path


def ros_map(folder: Path) -> Path:
    path = folder / "map.yaml"
    keys = {"resolution": 0.1, "origin": [0, 0, 0], "negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.2}
    path.write_text(yaml.safe_dump({"image": image(folder).name, **keys}))
    return path


def grid(folder: Path) -> Path:
    path = folder / "arena.map"
    path.write_text(f"type octile\nheight {SIDE}\nwidth {SIDE}\nmap\n" + f"{'.' * (SIDE - 1)}@\n" * SIDE)
    return path


def scene(folder: Path) -> Path:
    path = folder / "scene.yaml"
    things = [{"id": f"ball {i}", "primitives": [{"type": "sphere", "dimensions": [0.2 + i]}]} for i in range(SIDE)]
    path.write_text(yaml.safe_dump({"world": {"collision_objects": things}}))
    return path


def cells(world: World) -> list[object]:
    assert world.raster is not None
    return world.raster.cells.tolist()


READ: dict[str, Callable[[Path], list[object]]] = {
    "geojson": lambda folder: [o.polygon.wkt for o in World.from_geojson(polygons(folder)).obstacles],
    "zones": lambda folder: [zone.area.wkt for zone in geojson_content.read(zones=polygons(folder))[0].zones],
    "image": lambda folder: cells(World.from_image(image(folder), 0.1)),
    "ros_map": lambda folder: cells(World.from_ros_map(ros_map(folder))),
    "movingai": lambda folder: cells(World.from_movingai(grid(folder))),
    "moveit_scene": lambda folder: [o.describe() for o in World.from_moveit_scene(scene(folder)).bodies],
}


@pytest.fixture(autouse=True)
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    for module, size in (("geojson_document", SIDE), ("image", 5 * SIDE)):
        monkeypatch.setattr(f"hpop.world.readers.{module}.BLOCK", size)


@pytest.mark.cases(but=("zones",))
@pytest.mark.parametrize("name", READ)
def test_a_map_is_read_in_parts_that_can_be_stopped_between_and_are_the_same_map(tmp_path: Path, name: str) -> None:
    counted = Counted()
    with limits.within(counted):
        expected = READ[name](tmp_path)
    assert counted.asked.count(limits.READING) >= PARTS
    assert counted.held > 0
    for most in {1, len(counted.asked) // 2, len(counted.asked)}:
        with pytest.raises(Stop), limits.within(Counted(most)):
            READ[name](tmp_path)
    assert READ[name](tmp_path) == expected


def test_memory_for_a_map_is_refused_before_it_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "large.png"
    Image.new("L", (4000, 4000), 255).save(path)  # 16 million cells in some kilobytes
    spending = Spending(Budget(max_memory=50_000_000))
    with pytest.raises(limits.LimitPassed, match="memory limit while the map was read"), limits.within(spending):
        World.from_image(path, 0.1)
    assert spending.memory == 0


def test_a_limit_within_a_reader_of_an_installed_package_is_no_fault_of_the_map(tmp_path: Path) -> None:
    def plugin(path: Path) -> World:
        limits.check("a plan was read")
        return World.from_movingai(path)

    readers.add("text_plan", plugin)
    try:
        with pytest.raises(limits.LimitPassed), limits.within(Spending(Budget(time_limit=1e-9))):
            read_world("text_plan", grid(tmp_path))
    finally:
        del readers._types["text_plan"]


def scenario(folder: Path, *planners: dict[str, object]) -> Path:
    path = folder / "scenario.yaml"
    asked = {"start": [2, 2, 0], "goal": [8, 8, "any"], "criteria": ["turns", "length"]}
    path.write_text(
        yaml.safe_dump({"world": {"geojson": {"path": polygons(folder).name}}, **asked, "planner": list(planners)})
    )
    return path


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return a clock that advances by a second whenever a limit reads it."""
    now = [0.0]

    def look() -> float:
        now[0] += 1.0
        return now[0]

    monkeypatch.setattr("hpop.planners.spending.perf_counter", look)
    return now


@pytest.mark.parametrize("planner", ["lattice", "roadmap", "any-angle", "weighted-sum"])
def test_time_that_passes_while_the_map_is_read_ends_planning_midway(
    tmp_path: Path, clock: list[float], planner: str
) -> None:
    path = scenario(tmp_path, {planner: {"time_limit": 5}})
    with pytest.raises(LimitError, match=r"time limit reached while the map was read.*raise time_limit"):
        load_scenario(path)
    assert clock[0] < 10  # of the hundred times that reading the whole file looks at it


def test_a_map_is_read_whole_where_one_of_the_planners_may(tmp_path: Path, clock: list[float]) -> None:
    path = scenario(tmp_path, {"lattice": {"time_limit": 5}}, {"lattice": {"step": 0.5}})
    assert len(load_scenario(path).problem.world.obstacles) == SIDE * SIDE


def test_what_stays_of_reading_is_charged_to_the_planner(tmp_path: Path) -> None:
    path = scenario(tmp_path, {"lattice": {"step": 0.5}})
    loaded = load_scenario(path)
    (planner,) = loaded.planners
    spending = planner.spending(loaded.problem)  # type: ignore[attr-defined]
    assert spending.memory >= (tmp_path / "plan.geojson").stat().st_size
    assert spending.seconds() >= loaded.problem.read_seconds > 0


@pytest.mark.parametrize(("limit", "amount"), [("time_limit", 1e-9), ("max_memory", 1000)])
def test_the_command_says_which_limit_and_writes_nothing(tmp_path: Path, limit: str, amount: float) -> None:
    path, out = scenario(tmp_path, {"lattice": {limit: amount}}), tmp_path / "out"
    result = CliRunner().invoke(main, ["plan", str(path), "--out", str(out)])
    assert result.exit_code == 13
    assert re.search(f"reached while the map was read.*, before planning began; raise {limit}", result.output)
    assert "Traceback" not in result.output
    assert not out.exists()
