"""Claims: what is solid is derived once, whoever comes and goes; what people block is what it would be without that."""

import gc
import pickle
import weakref
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

import hpop
from hpop.planners.graph_planners import Lattice
from hpop.runtime import limits
from hpop.world import Ground, World
from hpop.world.content.content import Landmark, Person, Zone
from hpop.world.geometry.planar import FreeSpace
from hpop.world.ground import Cache
from hpop.world.sight.visibility import openness_field

MUSEUM = Path(hpop.__file__).parents[1] / "examples" / "museum.geojson"
ROBOT = hpop.DifferentialDrive(radius=0.3, camera_height=1.2)
PEOPLE = (Person(14.0, 15.0), Person(22.0, 12.0))
LANDMARKS = (Landmark(8.0, 16.0), Landmark(20.0, 4.0))
ZONES = (Zone("speed", shapely.box(5, 5, 12, 12), limit=0.5),)
STONES = (shapely.box(3, 0, 3.5, 3), shapely.box(5, 2, 6, 2.5), shapely.Point(1.5, 4.5).buffer(0.4))
HALL = shapely.box(0, 0, 8, 6)


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the fields that were sampled since the last look, a word for each."""
    found: list[str] = []
    hold = limits.hold

    def held(doing: str, stays: int, beside: int = 0) -> None:
        found.append(doing)
        hold(doing, stays, beside)

    monkeypatch.setattr(limits, "hold", held)
    return found


@pytest.fixture
def sampled(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return the number of points of each call of the signed clearance."""
    found: list[int] = []
    ask = FreeSpace.signed_clearance

    def asked(self: FreeSpace, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        found.append(x.size)
        return ask(self, x, y)

    monkeypatch.setattr(FreeSpace, "signed_clearance", asked)
    return found


def hall() -> World:
    return World.from_polygons(STONES, extent=HALL)


def test_when_a_person_moves_in_the_museum_no_field_of_what_is_solid_is_made_again(
    made: list[str], sampled: list[int]
) -> None:
    names = ["obstruction", "landmark_blindness", "openness", "optic_flow", "proximity", "speeding"]
    world, fields, samples = World.from_geojson(MUSEUM), [], []
    for x in (14.0, 14.5):
        made.clear()
        sampled.clear()
        people = (replace(PEOPLE[0], x=x), PEOPLE[1])
        world = world.with_content(people=people, landmarks=LANDMARKS, zones=ZONES)
        problem = hpop.Problem(world, ROBOT, (2, 10, 0), (28, 10, 0), names)
        Lattice(step=4.0).lattice(problem).graph(problem.criteria)
        fields.append(sorted(set(made)))
        samples.append(sum(sampled))
    assert len(fields[0]) == 6
    assert fields[1] == ["the clearance was sampled"]
    assert samples[1] < samples[0] / 30


def content(rng: np.random.Generator) -> dict[str, list[Person] | list[Zone]]:
    """People all over the hall and beyond it, and a zone or none, straight or slanting."""
    people = [Person(x, y) for x, y in rng.uniform(-1, 7, (int(rng.integers(0, 4)), 2)).tolist()]
    x, y, size = rng.uniform(0, 5, 3)
    areas = [shapely.box(x, y, x + size, y + size), shapely.Point(x, y).buffer(size, quad_segs=3)]
    return {"people": people, "zones": [Zone("keep-out", area) for area in areas[: int(rng.integers(0, 3))]]}


@pytest.mark.seeds(1, of=4)
def test_clearance_is_to_the_last_bit_that_of_a_world_made_afresh_whatever_was_there_before(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = hall()
    for _ in range(6):
        given = content(rng)
        world = world.with_content(**given)
        afresh = hall().with_content(**given)
        np.testing.assert_array_equal(world.clearance_field().values, afresh.clearance_field().values)


def test_where_a_person_moves_the_clearance_is_sampled_near_to_both_places_only(sampled: list[int]) -> None:
    world = World.from_polygons([shapely.box(10, 10, 11, 11)], extent=shapely.box(0, 0, 20, 20))
    world.with_content(people=[Person(3.0, 3.0)]).clearance_field()
    whole = sum(sampled)
    sampled.clear()
    field = world.with_content(people=[Person(3.0, 3.5)]).clearance_field()
    assert whole == field.values.size
    assert 0 < sum(sampled) < whole / 10


def test_equal_landmarks_and_zones_are_not_sampled_again(made: list[str]) -> None:
    world = hall()
    for x in (1.0, 2.0):
        made.clear()
        marks, zones = [replace(mark) for mark in LANDMARKS], [replace(zone) for zone in ZONES]
        world = world.with_content(people=[Person(x, 1.0)], landmarks=marks, zones=zones)
        problem = hpop.Problem(world, ROBOT, (0.5, 0.5, 0), (7, 5, 0), ["landmark_blindness", "speeding"])
        Lattice(step=1.0).lattice(problem).graph(problem.criteria)
    assert made == []


def test_other_landmarks_are_seen_from_the_same_ground(made: list[str]) -> None:
    world = hall()
    for marks in (LANDMARKS[:1], [Landmark(1.0, 1.0)]):
        made.clear()
        problem = hpop.Problem(
            world.with_content(landmarks=marks), ROBOT, (0.5, 0.5, 0), (7, 5, 0), ["landmark_blindness", "length"]
        )
        Lattice(step=1.0).lattice(problem).graph(problem.criteria)
    assert made == ["the visibility of landmarks was sampled"]


def test_what_is_derived_is_made_once_for_a_world_and_once_for_all_on_its_ground() -> None:
    world, calls = hall(), []
    other = world.with_content(people=[Person(1.0, 1.0)])
    for asked in (world, world, other):
        assert asked.derived(("mine",), lambda: calls.append("world") or 1) == 1
        assert asked.ground.derived(("mine",), lambda: calls.append("ground") or 2) == 2
    assert calls == ["world", "ground", "world"]


def test_what_a_world_derived_goes_with_it_and_what_the_ground_did_stays() -> None:
    world = hall()
    visited = world.with_content(people=[Person(1.0, 1.0)])
    visited.free_space()
    openness_field(visited, 1.2, 3.0)
    kept = weakref.ref(visited.cache)
    del visited
    gc.collect()
    assert kept() is None
    assert any(key[0] == "openness" for key in world.ground.cache._values)


def test_caches_beside_each_other_keep_together_what_one_may() -> None:
    ground = Cache(limit=400)
    worlds = [Cache(beside=ground) for _ in range(3)]
    for cache in (ground, *worlds):
        for name in "ab":
            cache.keep(name, np.zeros(10))  # 80 bytes
            assert ground.size + sum(world.size for world in worlds) <= 400
    assert [ground.find("a"), ground.find("b")] == [None, None]  # the least recently used
    assert all(worlds[2].find(name) is not None for name in "ab")


def test_a_stand_in_is_the_same_world_read_otherwise() -> None:
    class Sampled(World):
        def clearance(self, x: np.ndarray, y: np.ndarray, *, z: tuple[float, float] = (-np.inf, np.inf)) -> np.ndarray:
            return self.clearance_field(z=z)(x, y)

    world = hall().with_content(people=[Person(1.0, 1.0)])
    seen = world.stand_in(Sampled)
    x, y = np.array([1.7, 4.0]), np.array([1.3, 1.0])
    assert isinstance(seen, Sampled)
    assert seen.clearance(x, y) == pytest.approx(world.clearance(x, y), abs=0.1)
    assert seen.clearance_field() is world.clearance_field()


def test_worlds_on_one_ground_are_pickled_with_one() -> None:
    world = hall()
    one, other = pickle.loads(pickle.dumps((world, world.with_content(people=[Person(1.0, 1.0)]))))
    assert one.ground is other.ground
    assert one.obstruction_field(1.0) is other.obstruction_field(1.0)


def test_a_ground_alone_knows_its_free_space() -> None:
    ground = Ground(extent=HALL)
    assert ground.free_space().clearance(np.array([1.0, 4.0]), np.array([1.0, 3.0])).tolist() == [1.0, 3.0]
    assert ground.bounds == (0.0, 0.0, 8.0, 6.0)
