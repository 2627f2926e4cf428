"""Random worlds, motions and predictions of people for conformance checks, and a search for rates that jump."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, IntArray
from hpop.base.options import whole
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.errors import CriterionError
from hpop.models.driven import states_after
from hpop.motions import HOLD, Model, Motions, States
from hpop.motions.laws import CLOCK
from hpop.testing.contracts import (
    Check,
    differ,
    fault_of,
)
from hpop.world import Ground, MeasuredField, World, pose_at
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
WIDE = 30.0  # m: a wide world has its origin in the middle of a square of twice this side
NARROWEST, FASTEST = 1e-3, 5.0  # least distance, m, and largest speed, m/s, or turn rate, rad/s, of wide motions
LINES = ("position", "speed", "turn rate", "yaw")
RAYS, DENSITY = 12, 16  # lines for each quantity, and samples on each side of 0
ASIDE = 0.02  # m, standard deviation of the distances at which lines pass by people
MOMENT, BRACKET = 1e-6, 1e-5  # m, m/s, rad/s or rad: where a rate is sampled, and where it is said to jump
FIRST, HALVINGS = (
    6,
    22,
)  # least and largest number of times that an interval is halved, unless the rate hardly changes in it
LEAST_JUMP = 1e-2  # least change of a jump, as a share of the largest rate on the line
MOST_JUMPS, ACROSS = 6, 8  # largest number of jumps tried for each quantity, and motions across each jump


@checked_arguments
def random_world(rng: np.random.Generator) -> World:
    """Return a room of 12 x 9 m with random boxes, standing people, landmarks, zones, and a measured field."""
    corners = rng.uniform((0.5, 0.5), (10.0, 7.0), size=(8, 2))
    sizes = rng.uniform(0.3, 1.5, size=(8, 2))
    tops = rng.uniform(0.5, 2.5, size=8)
    boxes = [(shapely.box(*c, *(c + s)), (0.0, float(top))) for c, s, top in zip(corners, sizes, tops, strict=True)]
    places = rng.uniform((1.0, 1.0), (11.0, 8.0), size=(6, 2)).tolist()
    yaws = rng.uniform(-np.pi, np.pi, size=5).tolist()
    line = shapely.LineString(rng.uniform((1.0, 1.0), (11.0, 8.0), size=(3, 2)))
    room = World.from_polygons(boxes, extent=shapely.box(0.0, 0.0, 12.0, 9.0)).with_fields([latency()])
    return room.with_content(
        people=[Person(x, y, yaw) for (x, y), yaw in zip(places[:3], yaws[:3], strict=True)],
        groups=[(0, 1)],
        landmarks=[Landmark(x, y, facing=facing) for (x, y), facing in zip(places[3:], [None, *yaws[3:]], strict=True)],
        zones=[
            Zone("speed", shapely.box(2.0, 2.0, 8.0, 6.0), limit=0.5),
            Zone("one-way", line.buffer(1.5), path=line),
        ],
    )


def latency() -> MeasuredField:
    """Return a measured field over the room of :func:`random_world`: 20 to 180 ms, a sample each 1.5 m."""
    x, y = np.meshgrid(np.arange(9.0), np.arange(7.0))
    return MeasuredField(100.0 + 80.0 * np.sin(x + 2.0 * y), 1.5, name="latency", unit="ms", outside=100.0)


@checked_arguments
def reframed(world: World) -> World:
    """Return a copy of a world without cells, rotated and shifted by ``FRAME`` with its people, landmarks and zones."""

    def place(geometry: Any) -> Any:
        return shapely.transform(geometry, lambda points: np.stack(in_frame(points[:, 0], points[:, 1]), axis=1))

    def pose(thing: Any, facing: str) -> dict[str, Any]:
        x, y = in_frame(thing.x, thing.y)
        angle = getattr(thing, facing)
        return {"x": float(x), "y": float(y), facing: None if angle is None else angle + FRAME[2]}

    content = world.content
    prisms = [replace(prism, polygon=place(prism.polygon)) for prism in world.obstacles if prism.solid is None]
    frame = pose_at((*FRAME[:2], 0.0), rpy=(0.0, 0.0, FRAME[2]))
    solids = [replace(solid, pose=frame @ solid.pose) for solid in world.ground.solids]
    fields = [replace(each, origin=(*in_frame(*each.origin[:2]), each.origin[2] + FRAME[2])) for each in world.fields]
    there = World(Ground(tuple(prisms), extent=place(world.extent), solids=tuple(solids)), fields=fields)
    return there.with_content(
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
    for count in (4 * size + 20, x.size):  # the first are nearly always enough
        is_free = world.clearance(x[:count], y[:count]) > 0.5
        if is_free.sum() >= size:
            break
    x, y = (column[:count][is_free][:size] for column in (x, y))
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


def wide_world(world: World) -> World:
    """Return a world with the same obstacles and content, in a square of 60 m around the origin."""
    c = world.content
    wide = World(Ground(world.obstacles, extent=shapely.box(-WIDE, -WIDE, WIDE, WIDE)), fields=world.fields)
    return wide.with_content(people=c.people, groups=c.groups, landmarks=c.landmarks, zones=c.zones)


def wide_motions(rng: np.random.Generator, wide: World, model: Model, size: int) -> list[Motions]:
    """Return moves and curves (size,) at positions, speeds and turn rates of both signs and of all magnitudes."""

    def drawn(most: float) -> FloatArray:
        magnitude: FloatArray = np.exp(rng.uniform(np.log(NARROWEST), np.log(most), size))
        return np.copysign(magnitude, rng.uniform(-1.0, 1.0, size))

    x, y, yaw = drawn(0.9 * WIDE), drawn(0.9 * WIDE), rng.uniform(-np.pi, np.pi, size)
    length, lasts = rng.uniform(0.1, 0.4, (2, size))
    clock = np.zeros(size)
    start = States(x=x, y=y, yaw=yaw)
    end = States(x=x + length * np.cos(yaw), y=y + length * np.sin(yaw), yaw=yaw)
    fast = States(x=x, y=y, yaw=yaw, speed=drawn(FASTEST), turn_rate=drawn(FASTEST), clock=clock)
    speed, turn_rate = drawn(FASTEST), drawn(FASTEST)
    curve_end = states_after(fast, (speed - fast.speed) / lasts, (turn_rate - fast.turn_rate) / lasts, lasts)
    move, drive = model.laws["move"], model.laws["drive"]
    return [Motions(wide, model, move, start, end, t0=clock), Motions(wide, model, drive, fast, curve_end, t0=clock)]


class _StateLines:
    """Lines in the space of states, along each of which one quantity varies: position, speed, turn rate or yaw.

    Lines of positions pass by the origin, people, landmarks and random places. The quantity is then the signed
    distance from there, m. They do not pass exactly through a person, where even a good rate may jump.
    """

    def __init__(self, rng: np.random.Generator, wide: World, model: Model, quantity: str) -> None:
        self.world, self.model, self.quantity = wide, model, quantity
        content = wide.content
        places = [(person.x, person.y) for person in content.people] + [(one.x, one.y) for one in content.landmarks]
        places = [(0.0, 0.0), (0.0, 0.0), *places][:RAYS]
        free = rng.uniform((1.0, 1.0), (11.0, 8.0), size=(RAYS - len(places), 2))
        beside = np.concatenate([np.array(places), free]) + rng.normal(0.0, ASIDE, (RAYS, 2))
        self.x, self.y = beside.T
        self.yaw = np.arange(RAYS) % 2 * (np.pi / 2) + rng.uniform(-0.4, 0.4, RAYS)  # to about east or north

    def samples(self) -> FloatArray:
        """Return the sampled values (2 * DENSITY + 1,) of the quantity, in ascending order."""
        if self.quantity == "yaw":
            return np.linspace(-np.pi, np.pi, 2 * DENSITY + 1)
        most = 0.8 * WIDE if self.quantity == "position" else FASTEST
        above = np.geomspace(NARROWEST, most, DENSITY)
        return np.concatenate([-above[::-1], [0.0], above])

    def motions(self, line: IntArray, begin: FloatArray, end: FloatArray) -> Motions:
        """Return motions (N,) along lines, in which the quantity rises from ``begin`` to ``end``."""
        x, y, yaw, clock = self.x[line], self.y[line], self.yaw[line], np.zeros(line.size)
        if self.quantity == "position":
            ends = [States(x=x + r * np.cos(yaw), y=y + r * np.sin(yaw), yaw=yaw) for r in (begin, end)]
            return Motions(self.world, self.model, self.model.laws["move"], ends[0], ends[1], t0=clock)
        columns = {"yaw": yaw, "speed": clock + 0.5, "turn_rate": clock + float(self.quantity == "yaw")}
        columns[self.quantity.replace(" ", "_")] = begin
        faster, tighter = (clock + float(self.quantity == name) for name in ("speed", "turn rate"))
        start = States(x=x, y=y, **columns, clock=clock)
        law = self.model.laws["drive"]
        return Motions(self.world, self.model, law, start, states_after(start, faster, tighter, end - begin), t0=clock)

    def rates(self, criterion: Criterion, line: IntArray, value: FloatArray) -> FloatArray:
        """Return the cost per second (N,) of very short motions on lines, at values (N,) of the quantity."""
        motions = self.motions(line, value, value + MOMENT)
        return np.asarray(motion_costs(criterion, motions) / motions.duration)

    def jumps(self, criterion: Criterion) -> Iterator[tuple[int, float, float, float]]:
        """Yield the largest jumps of a rate: line, value of the quantity, and the rates before and after.

        Intervals between samples in which the rate changes are halved again and again; the half in which it changes
        more is kept. An interval is dropped as soon as its change shrinks about as fast as its width.
        """
        samples = self.samples()
        every = np.repeat(np.arange(RAYS), samples.size)
        found = self.rates(criterion, every, np.tile(samples, RAYS)).reshape(RAYS, samples.size)
        scale = np.abs(found).max(axis=1)
        line, interval = np.nonzero(np.abs(np.diff(found, axis=1)) > LEAST_JUMP * scale[:, None])
        low, high = samples[interval], samples[interval + 1]
        before, after = found[line, interval], found[line, interval + 1]
        first = np.abs(after - before)
        for halving in range(HALVINGS):
            if not line.size:
                return
            middle = np.where(high - low < BRACKET, low, 0.5 * (low + high))
            between = self.rates(criterion, line, middle)
            lower = np.abs(between - before) >= np.abs(after - between)
            low, high = np.where(lower, low, middle), np.where(lower, middle, high)
            before, after = np.where(lower, before, between), np.where(lower, between, after)
            change = np.abs(after - before)
            kept = change > LEAST_JUMP * scale[line]
            if halving >= FIRST:
                kept &= change > 4.0 * first * 0.5 ** (halving + 1)
            line, low, high, before, after, first = (c[kept] for c in (line, low, high, before, after, first))
        change = np.where(high - low < BRACKET, np.abs(after - before), 0.0)
        for i in np.argsort(-change, kind="stable")[:MOST_JUMPS]:
            if change[i]:
                yield int(line[i]), float(high[i]), float(before[i]), float(after[i])


def jumps_across(
    criterion: Criterion, rng: np.random.Generator, wide: World, model: Model
) -> Iterator[tuple[str, Motions]]:
    """Yield motions (ACROSS,) across each place where the rate of a criterion jumps, with a text on the jump."""
    for quantity in LINES:
        lines = _StateLines(rng, wide, model, quantity)
        for line, value, before, after in lines.jumps(criterion):
            width, share = rng.uniform((0.1, 0.1), (0.4, 0.9), (ACROSS, 2)).T
            m = lines.motions(np.full(ACROSS, line), value - share * width, value + (1.0 - share) * width)
            x, y = lines.x[line], lines.y[line]
            if quantity == "position":
                x, y = x + value * np.cos(lines.yaw[line]), y + value * np.sin(lines.yaw[line])
            at = "" if quantity == "position" else f" at a {quantity} of {value:.4g}"
            yield f"the rate jumps from {before:.4g} to {after:.4g}{at} near x = {x:.4g}, y = {y:.4g}", m


def sure_world(world: World) -> World:
    """Return a world with certain predictions: for a minute, people follow a track, walk and then leave, or stand."""
    doings = (_on_a_track, lambda person: replace(person, velocity=(-0.03, 0.02), until=40.0), lambda person: person)
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
    """Return whether a criterion raises CriterionError in a world, as it may for uncertain predictions of people."""
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


def _costs(criterion: Criterion, world: World, batches: list[Motions]) -> FloatArray:
    return np.concatenate([motion_costs(criterion, replace(motions, world=world)) for motions in batches])


def _hypotheses_fault(criterion: Criterion, world: World, batches: list[Motions]) -> str:
    """Return a fault if the cost for a person with two futures does not fit those for each alone; "" otherwise."""
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


def drawn_states(model: Model, world: World, rng: np.random.Generator, size: int) -> States:
    """Return random states (size,) anywhere in a world, within the model's limits."""
    x_min, y_min, x_max, y_max = world.bounds
    spans = {"x": (x_min, x_max), "y": (y_min, y_max)}
    return model.space.bounded(**{n: s for n, s in spans.items() if n in model.space.names}).sample(rng, size)
