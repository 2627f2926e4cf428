"""Claims: fields are made in parts that ask the limits of whoever plans; one that was stopped is not kept."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.base.registry import criteria
from hpop.criteria.others import zones
from hpop.planners.graph_planners import Lattice
from hpop.runtime import limits
from hpop.world import Field, World
from hpop.world.content.content import Landmark, Zone
from hpop.world.ground import nbytes
from hpop.world.sight import visibility
from hpop.world.sight.bearings import bearings
from hpop.world.sight.visibility import landmarks_unseen, openness_field

ROUND = hpop.DifferentialDrive(radius=0.3, camera_height=1.2)
PATH = shapely.LineString([(1, 1), (7, 1)])


class Stop(Exception):
    pass


@dataclass
class Counted:
    """Limits that count what they are asked, and stop at some question."""

    most: float = float("inf")
    asked: list[str] = field(default_factory=list)
    held: int = 0
    peak: int = 0

    def check(self, doing: str, memory: int = 0) -> None:
        self.asked.append(doing)
        self.peak = max(self.peak, self.held + memory)
        if len(self.asked) >= self.most:
            raise Stop

    def hold(self, memory: int, doing: str) -> None:
        self.held += memory


def hall() -> World:
    boxes = [shapely.box(3, 0, 3.5, 3), shapely.box(5, 2, 6, 2.5)]
    world = World.from_polygons(boxes, extent=shapely.box(0, 0, 8, 6))
    areas = [Zone("speed", shapely.box(0, 0, 8, 6), limit=0.5), Zone("one-way", PATH.buffer(0.5), path=PATH)]
    return world.with_content(landmarks=[Landmark(1.0, 5.0), Landmark(7.0, 3.0)], zones=areas)


def pose(world: World) -> Any:
    x = np.linspace(0.5, 7.5, 20)
    return ROUND.pose("camera", hpop.motions.States(x=x, y=0 * x + 5.0, yaw=x))


MAKE: dict[str, Callable[[World], Any]] = {
    "clearance": lambda world: world.clearance_field().values,
    "obstruction": lambda world: world.obstruction_field(1.0)(np.array([1.0, 4.0, 7.0]), np.array([1.0, 5.0, 1.0])),
    "openness": lambda world: openness_field(world, 1.2, 3.0).values,
    "landmarks all round": lambda world: landmarks_unseen(world, pose(world), near=1.0, far=5.0),
    "landmarks in view": lambda world: landmarks_unseen(world, pose(world), near=1.0, far=5.0, fov=1.0),
    "bearings": lambda world: bearings(world, 1.2).layers(0.1),
    "speed limits": lambda world: [area.values for _, area in zones.speed_limits(world)],
    "flows": lambda world: [part.values for flow in zones.one_way_flows(world) for part in flow],
}


@pytest.fixture(params=MAKE)
def make(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Callable[[World], Any]:
    for name in ("hpop.world.sight.bearings.CAST", "hpop.criteria.others.zones.ROWS"):
        monkeypatch.setattr(name, 200)
    return MAKE[request.param]


def test_a_field_asks_between_its_parts_and_one_that_was_stopped_is_made_whole_later(
    make: Callable[[World], Any],
) -> None:
    world, counted = hall(), Counted()
    with limits.within(counted):
        expected = make(world)
    assert len(counted.asked) > 2
    for most in {1, len(counted.asked) // 2, len(counted.asked)}:
        stopped = hall()
        with pytest.raises(Stop), limits.within(Counted(most)):
            make(stopped)
        for made, known in zip(make(stopped), expected, strict=True):
            np.testing.assert_array_equal(made, known)


def test_what_a_field_keeps_is_held(make: Callable[[World], Any]) -> None:
    world, counted = hall(), Counted()
    caches = world.cache, world.ground.cache
    before = sum(cache.size for cache in caches)
    with limits.within(counted):
        make(world)
    others = ("solid", "free", "outlines", "last clearance")  # the last is also there as what it is
    fields = [value for cache in caches for key, (_, value) in cache._values.items() if key[0] not in others]
    kept = nbytes(fields) - before
    assert kept * 0.6 < counted.held < 1.5 * kept + 1000
    assert counted.peak >= counted.held


def test_without_limits_nothing_is_asked() -> None:
    counted = Counted()
    with limits.within(counted):
        pass
    openness_field(hall(), 1.2, 3.0)
    assert counted.asked == []


@dataclass(frozen=True)
class Wide:
    """A criterion of one's own that has a field of hpop's made."""

    def cost(self, m: hpop.Motions) -> Any:
        field = openness_field(m.world, 1.2, 3.0)
        return m.integrate(lambda s: field(s.camera.x, s.camera.y))


def test_a_limit_passed_within_a_criterion_of_ones_own_is_a_result() -> None:
    mine = hpop.criterion("wide", group="P", unit="s", aggregate="sum", requires=("camera",))(Wide)
    try:
        problem = hpop.Problem(hall(), ROUND, (1.0, 1.0, 0.0), (7.0, 1.0, None), [mine(), "length"])
        front = problem.solve(Lattice(step=0.5, max_memory=300_000))
    finally:
        del criteria._types["wide"]
    assert (front.status, len(front)) == ("memory limit", 0)
    assert any("openness was sampled" in note for note in front.notes)


@pytest.mark.parametrize("name", ["openness", "enclosure", "landmark_visibility"])
def test_a_planner_refuses_a_field_that_its_memory_does_not_hold(name: str) -> None:
    problem = hpop.Problem(hall(), ROUND, (1.0, 1.0, 0.0), (7.0, 1.0, None), [name, "length"])
    planner = Lattice(step=0.5)
    bare = planner.lattice(problem)
    room = bare.arcs.heads.size * (2 * 8 + 16) + 20_000  # bytes: the graph, and no field
    front = problem.solve(Lattice(step=0.5, max_memory=room))
    assert (front.status, len(front)) == ("memory limit", 0)
    (note,) = (note for note in front.notes if note.startswith("memory limit"))
    assert "sampled, which takes" in note
    assert "raise max_memory" in note
    assert len(problem.solve(Lattice(step=0.5))) > 0


def test_time_that_passes_while_a_field_is_made_ends_planning(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = hpop.Problem(hall(), ROUND, (1.0, 1.0, 0.0), (7.0, 1.0, None), ["openness", "length"])
    clock, tiles = [0.0], []

    def later(world: World, *options: Any) -> Field:
        clock[0] += 100.0
        tiles.append(options)
        return sample(world, *options)

    sample = visibility._sample_openness
    monkeypatch.setattr(visibility, "_sample_openness", later)
    monkeypatch.setattr("hpop.planners.spending.perf_counter", lambda: clock[0])
    front = problem.solve(Lattice(step=0.5, time_limit=50.0))
    assert (front.status, len(front), len(tiles)) == ("time limit", 0, 1)
    assert any("it was passed while the openness was sampled" in note for note in front.notes)
