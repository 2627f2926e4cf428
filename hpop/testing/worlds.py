"""Random worlds, motions and predictions of people for conformance checks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.options import whole
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.errors import CriterionError
from hpop.models.driven import states_after
from hpop.motions import HOLD, Model, Motions, States
from hpop.motions.laws import CLOCK
from hpop.testing.contracts import Check, differ, fault_of
from hpop.world import Ground, Obstacle, World, pose_at
from hpop.world.content.content import Landmark, Zone
from hpop.world.content.futures import Future
from hpop.world.content.people import Person
from hpop.world.tracks import Track

FRAME = (-7.3, 4.1, 0.7)  # m, m, rad: position and yaw of the map's frame in another frame
MOST_DRAWN = 100_000
"""Largest number of motions in one draw."""
TOLERANCE = 2e-3  # relative: the panels of integrals end where people turn, so they differ between worlds
ASKED = ("move", HOLD.kind)
SLACK = 0.1  # relative tolerance of a worst moment, since it lies between two samples


@checked_arguments
def random_world(rng: np.random.Generator) -> World:
    """Return a room of 12 x 9 m with random boxes, standing people, landmarks and zones."""
    corners = rng.uniform((0.5, 0.5), (10.0, 7.0), size=(8, 2))
    sizes = rng.uniform(0.3, 1.5, size=(8, 2))
    tops = rng.uniform(0.5, 2.5, size=8)
    boxes = [(shapely.box(*c, *(c + s)), (0.0, float(top))) for c, s, top in zip(corners, sizes, tops, strict=True)]
    places = rng.uniform((1.0, 1.0), (11.0, 8.0), size=(6, 2)).tolist()
    yaws = rng.uniform(-np.pi, np.pi, size=5).tolist()
    line = shapely.LineString(rng.uniform((1.0, 1.0), (11.0, 8.0), size=(3, 2)))
    return World.from_polygons(boxes, extent=shapely.box(0.0, 0.0, 12.0, 9.0)).with_content(
        people=[Person(x, y, yaw) for (x, y), yaw in zip(places[:3], yaws[:3], strict=True)],
        groups=[(0, 1)],
        landmarks=[Landmark(x, y, facing=facing) for (x, y), facing in zip(places[3:], [None, *yaws[3:]], strict=True)],
        zones=[
            Zone("speed", shapely.box(2.0, 2.0, 8.0, 6.0), limit=0.5),
            Zone("one-way", line.buffer(1.5), path=line),
        ],
    )


@checked_arguments
def reframed(world: World) -> World:
    """Return a world of polygons and solids, with its content, rotated and shifted by ``FRAME``."""

    def place(geometry: Any) -> Any:
        return shapely.transform(geometry, lambda points: np.stack(in_frame(points[:, 0], points[:, 1]), axis=1))

    def pose(thing: Any, facing: str) -> dict[str, Any]:
        x, y = in_frame(thing.x, thing.y)
        angle = getattr(thing, facing)
        return {"x": float(x), "y": float(y), facing: None if angle is None else angle + FRAME[2]}

    content = world.content
    prisms = [Obstacle(place(prism.polygon), *prism.heights) for prism in world.obstacles if prism.solid is None]
    frame = pose_at((*FRAME[:2], 0.0), rpy=(0.0, 0.0, FRAME[2]))
    solids = [replace(solid, pose=frame @ solid.pose) for solid in world.ground.solids]
    return World(Ground(tuple(prisms), extent=place(world.extent), solids=tuple(solids))).with_content(
        people=[replace(person, **pose(person, "yaw")) for person in content.people],
        groups=content.groups,
        landmarks=[replace(landmark, **pose(landmark, "facing")) for landmark in content.landmarks],
        zones=[
            replace(zone, area=place(zone.area), path=None if zone.path is None else place(zone.path))
            for zone in content.zones
        ],
    )


def in_frame(x: Any, y: Any) -> tuple[Any, Any]:
    """Return positions (x, y), m, in the frame ``FRAME``."""
    cos, sin = np.cos(FRAME[2]), np.sin(FRAME[2])
    return cos * x - sin * y + FRAME[0], sin * x + cos * y + FRAME[1]


@checked_arguments
def random_motions(rng: np.random.Generator, world: World, model: Model, kind: str, size: int) -> Motions:
    """Return random motions (size,) of one kind: "move", "turn", "hold" or "drive" (curves).

    They begin at positions over 0.5 m from obstacles. Moves are at most 0.4 m long, and turns at most half a turn; some
    turns cross yaw = pi. Every third curve begins or ends at rest; every fourth one turns first to one side and then to
    the other.
    """
    size = whole("size", size, 1, MOST_DRAWN, "a number of motions")
    x, y = rng.uniform((0.5, 0.5), (11.5, 8.5), size=(50 * size + 1000, 2)).T
    x, y = (column[world.clearance(x, y) > 0.5][:size] for column in (x, y))
    yaw = rng.uniform(-np.pi, np.pi, size)
    if kind == "drive":
        speeds, bends = rng.uniform(0.3, 1.0, (2, size)), rng.uniform(0.4, 1.5, (2, size))
        speeds[rng.integers(0, 2, size), np.arange(size)] *= np.arange(size) % 3 > 0
        bends = bends * rng.choice([-1.0, 1.0], size) * np.array([np.ones(size), np.where(np.arange(size) % 4, 1, -1)])
        lasts = rng.uniform(0.2, 0.4, size)
        start = States(x=x, y=y, yaw=yaw, speed=speeds[0], turn_rate=bends[0], clock=rng.uniform(0, 60, size))
        end = states_after(start, (speeds[1] - speeds[0]) / lasts, (bends[1] - bends[0]) / lasts, lasts)
        return Motions(world, model, model.laws[kind], start, end, t0=start.clock)
    if kind == HOLD.kind:
        return holds(world, model, States(x=x, y=y, yaw=yaw), rng)
    length = rng.uniform(0.1, 0.4, size) if kind == "move" else np.zeros(size)
    turn = rng.uniform(0.2, 3.1, size) * rng.choice([-1.0, 1.0], size) if kind == "turn" else np.zeros(size)
    end = States(x=x + length * np.cos(yaw), y=y + length * np.sin(yaw), yaw=yaw + turn)
    return Motions(world, model, model.laws[kind], States(x=x, y=y, yaw=yaw), end, t0=rng.uniform(0, 60, size))


def holds(world: World, model: Model, states: States, rng: np.random.Generator) -> Motions:
    """Return holds in states (M,), with random durations up to three seconds and random start times."""
    clock, lasts = rng.uniform(0, 60, states.size), rng.uniform(0.2, 3.0, states.size)
    start, end = (States(**states.__dict__ | {CLOCK: time}) for time in (clock, clock + lasts))
    return Motions(world, model, HOLD, start, end, t0=clock)


def sure_world(world: World) -> World:
    """Return a world with certain predictions: for a minute, people follow a track, walk and then leave, or stand."""
    doings = (_on_a_track, _with_end, lambda person: person)
    people = [doings[i % 3](person) for i, person in enumerate(world.content.people)]
    return with_people(world, people)


def open_world(world: World) -> World:
    """Return a world with uncertain predictions: each person has two futures, one with a growing spread."""
    people = [
        replace(
            person,
            spread=0.2,
            futures=(
                Future(2.0, velocity=(0.02, 0.03), growth=0.01),
                Future(1.0, track=_on_a_track(person).track, afterwards="stays"),
            ),
        )
        for person in world.content.people
    ]
    return with_people(world, people)


def prediction_checks(criterion: Criterion, world: World, batches: list[Motions]) -> Iterator[Check]:
    """Yield checks of a criterion with people who have several futures, and with people who have left.

    A criterion may refuse futures and uncertain positions with a CriterionError.
    """
    yield Check(
        "takes each possible future of a person into account",
        fault_of(lambda: _hypotheses_fault(criterion, world, batches)),
    )
    yield Check("ignores people who have left", fault_of(lambda: _absence_fault(criterion, world, batches)))


def predicted_batches(criterion: Criterion, world: World, batches: list[Motions]) -> list[Motions]:
    """Return copies of the batches of moves and holds in two worlds: people walk, or each person has two futures.

    Worlds that the criterion refuses are left out.
    """
    worlds = [one for one in (sure_world(world), open_world(world)) if not refuses(criterion, one, batches)]
    asked = [motions for motions in batches if motions.kind in ASKED and len(motions) > 1]
    return [replace(motions, world=one) for one in worlds for motions in asked]


def refuses(criterion: Criterion, world: World, batches: list[Motions]) -> bool:
    """Return whether a criterion refuses the predictions of a world."""
    try:
        _costs(criterion, world, batches[:1])
    except CriterionError:
        return True
    return False


def with_people(world: World, people: list[Person]) -> World:
    """Return a world with other people."""
    content = world.content
    return world.with_content(people=people, groups=content.groups, landmarks=content.landmarks, zones=content.zones)


def _on_a_track(person: Person) -> Person:
    x, y = person.x, person.y
    track = Track.through([(0, x, y), (25, x + 1.5, y + 0.5), (40, x + 0.5, y + 1.0), (58, x, y - 0.5)])
    return replace(person, track=track, afterwards="stays")


def _with_end(person: Person) -> Person:
    return replace(person, velocity=(-0.03, 0.02), until=40.0)


def _costs(criterion: Criterion, world: World, batches: list[Motions]) -> FloatArray:
    return np.concatenate([motion_costs(criterion, replace(motions, world=world)) for motions in batches])


def _hypotheses_fault(criterion: Criterion, world: World, batches: list[Motions]) -> str:
    """Return a fault if the cost for a person with two futures does not fit the costs for each future alone."""
    everyone = open_world(world).content.people
    if refuses(criterion, with_people(world, list(everyone)), batches):
        return ""
    others = [replace(person, futures=()) for person in everyone[1:]]
    found = _costs(criterion, with_people(world, [everyone[0], *others]), batches)
    weights, sure = zip(*everyone[0].hypotheses, strict=True)
    each = np.stack([_costs(criterion, with_people(world, [person, *others]), batches) for person in sure])
    shares = each * np.array(weights)[:, None]
    worst = criterion.aggregate == "max"
    least, most = shares.max(axis=0) if worst else shares.sum(axis=0), each.sum(axis=0)
    slack = (SLACK if worst else TOLERANCE) * found.max()
    wrong = (found < least - slack) | (found > most + slack)
    if not wrong.any():
        return ""
    i = int(np.argmax(wrong))
    return (
        f"for a person with two futures, the cost must be between {least[i]:.6g}, the "
        f"{'largest weighted cost' if worst else 'mean'} of the futures, and {most[i]:.6g}, their sum, "
        f"got {found[i]:.6g}; see hpop.world.content.proxemics.expected"
    )


def _absence_fault(criterion: Criterion, world: World, batches: list[Motions]) -> str:
    people = list(sure_world(world).content.people)
    gone = Person(6.0, 4.5, velocity=(0.02, 0.0), until=0.0)
    there, without = (_costs(criterion, with_people(world, some), batches) for some in ([*people, gone], people))
    return differ("with a person who has left", without, there, TOLERANCE)
