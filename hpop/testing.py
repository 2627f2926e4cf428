"""Conformance checks for anyone's criterion: what planners and fronts rely on, shown on random worlds.

``hpop check module:Name`` prints them; :func:`check_criterion` raises, for use in tests.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import shapely

from hpop.arrays import Column, FloatArray
from hpop.criteria.base import Criterion, motion_costs, running_costs, trajectory_cost, trajectory_costs
from hpop.errors import CriterionError
from hpop.models.differential_drive.driven import ahead, driven
from hpop.motions import Model, Motions, States
from hpop.planners.lattice.graph import StateLattice
from hpop.planners.lattice.grid import Headings
from hpop.registry import make_model
from hpop.text import shown
from hpop.trajectory import Trajectory
from hpop.world import World
from hpop.world.content import Landmark, Person, Zone

KINDS = ("move", "turn", "drive")
CUT_TOLERANCE = 5e-3  # relative, of a curve: what it costs may jump where a wheel begins to turn the other way
SPLIT_TOLERANCE = 2e-3  # relative: two quadratures of one integral
GRADIENT_STEP = 1e-5  # m or rad, of the central difference
GRADIENT_TOLERANCE = 1e-3
FRAME = (-7.3, 4.1, 0.7)  # m, m, rad: where another frame lies
FRAME_TOLERANCE = 0.03  # relative: fields of 0.1 m cells, sampled on a grid that lies otherwise


class Check(NamedTuple):
    """One conformance check: what it claims, and what contradicts it ("" where it holds)."""

    claim: str
    fault: str


def check_criterion(criterion: Criterion, *, seed: int = 0) -> None:
    """Raise CriterionError that lists every check a criterion fails, on worlds drawn with a seed."""
    if isinstance(criterion, type) or not isinstance(criterion, Criterion):
        made = f"{criterion.__name__}()" if isinstance(criterion, type) else "Turns()"
        raise CriterionError(f"expected an instance of a criterion, such as {made}, got {shown(criterion)}")
    faults = [f"{check.claim}: {check.fault}" for check in conformance(criterion, seed=seed) if check.fault]
    if faults:
        raise CriterionError(f"criterion {criterion.name!r} fails {len(faults)} checks:\n  " + "\n  ".join(faults))


def conformance(criterion: Criterion, *, seed: int = 0) -> Iterator[Check]:
    """Check what a criterion promises, one check after the other; of one that gives no costs, no more than that."""
    rng = np.random.default_rng(seed)
    model = make_model({"differential_drive": {"camera_offset": (0.1, 0.05)}})
    world = random_world(rng)
    if criterion.aggregate == "trajectory":
        trajectories = [*(_detour(model, scale) for scale in (0.3, 1.0)), _slalom(model)]

        def ask(asked: Criterion) -> FloatArray:
            return np.concatenate([running_costs(asked, trajectory, world) for trajectory in trajectories])

    else:
        batches = [random_motions(rng, world, model, kind, size) for kind in KINDS for size in (1, 40)]

        def ask(asked: Criterion) -> FloatArray:
            return np.concatenate([motion_costs(asked, motions) for motions in batches])

    finite = Check(
        "costs a finite number >= 0 for each motion", _fault(lambda: "" if ask(criterion).size else "no costs")
    )
    yield finite
    if finite.fault:  # the other checks compare costs: they would all say this again
        return
    yield Check("survives pickling", _fault(lambda: _pickled(criterion, ask)))
    yield Check(
        "gives the same costs when asked again",
        _fault(lambda: _differ("the second time", ask(criterion), ask(criterion), 0.0)),
    )
    if not getattr(criterion, "world_frame", False):
        yield Check(
            "costs the same wherever the world's frame lies", _fault(lambda: _reframed(criterion, world, model))
        )
    if hasattr(criterion, "bound"):
        yield Check("bounds the cost of every trajectory from below", _fault(lambda: _bounded(criterion, world, model)))
    if criterion.aggregate == "trajectory":
        return
    yield Check("costs the same on a trajectory as on its edges", _fault(lambda: _as_edges(criterion, world, model)))
    yield Check("adds up along lattice edges to the trajectory's cost", _fault(lambda: _walk(criterion, rng, world)))
    yield Check("costs a motion the same alone and in a batch", _fault(lambda: _alone(criterion, batches)))
    yield Check("costs halves of a move as much as the whole", _fault(lambda: _halves(criterion, batches)))
    yield Check("costs the same wherever a curve is cut", _fault(lambda: _cut(criterion, rng, world, model)))
    if criterion.smooth:
        yield Check("has the same value on CasADi symbols", _fault(lambda: _symbolic(criterion, batches)))
        yield Check("has the gradient of its differences", _fault(lambda: _gradient(criterion, batches)))


def random_world(rng: np.random.Generator) -> World:
    """A room of 12 x 9 m with boxes of random places, sizes and heights, standing people, landmarks and zones."""
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


def random_motions(rng: np.random.Generator, world: World, model: Model, kind: str, size: int) -> Motions:
    """Short moves, turns of up to half a turn either way across yaw = pi, or curves; 0.5 m from what is blocked.

    Every third curve begins or ends standing, every fourth turns first one way and then the other.
    """
    x, y = rng.uniform((0.5, 0.5), (11.5, 8.5), size=(50 * size + 1000, 2)).T
    x, y = (column[world.clearance(x, y) > 0.5][:size] for column in (x, y))
    yaw = rng.uniform(-np.pi, np.pi, size)
    if kind == "drive":
        speeds, bends = rng.uniform(0.3, 1.0, (2, size)), rng.uniform(0.4, 1.5, (2, size))
        speeds[rng.integers(0, 2, size), np.arange(size)] *= np.arange(size) % 3 > 0
        bends = bends * rng.choice([-1.0, 1.0], size) * np.array([np.ones(size), np.where(np.arange(size) % 4, 1, -1)])
        lasts = rng.uniform(0.2, 0.4, size)
        start = States(x=x, y=y, yaw=yaw, speed=speeds[0], turn_rate=bends[0], clock=rng.uniform(0, 60, size))
        end = ahead(start, (speeds[1] - speeds[0]) / lasts, (bends[1] - bends[0]) / lasts, lasts)
        return Motions(world, model, model.laws[kind], start, end, t0=start.clock)
    length = rng.uniform(0.1, 0.4, size) if kind == "move" else np.zeros(size)
    turn = rng.uniform(0.2, 3.1, size) * rng.choice([-1.0, 1.0], size) if kind == "turn" else np.zeros(size)
    end = States(x=x + length * np.cos(yaw), y=y + length * np.sin(yaw), yaw=yaw + turn)
    return Motions(world, model, model.laws[kind], States(x=x, y=y, yaw=yaw), end, t0=rng.uniform(0, 60, size))


def _fault(test: Callable[[], str]) -> str:
    """What a check found; a criterion under test may raise anything, and that is a fault, not a crash."""
    try:
        return test()
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def _differ(what: str, expected: FloatArray, found: FloatArray, tolerance: float, scale: float | None = None) -> str:
    """Where two columns differ by more than a share of each value and of a scale, by default that of the largest."""
    gap = np.abs(expected - found)
    largest = float(np.abs(expected).max(initial=0.0)) if scale is None else scale
    allowed = tolerance * np.maximum(np.abs(expected), largest)
    if np.all(gap <= allowed):  # not a number is a fault
        return ""
    worst = int(np.argmax(np.where(np.isnan(gap), np.inf, gap - allowed)))
    return f"{what}: expected {expected.flat[worst]:.6g}, found {found.flat[worst]:.6g}"


def _pickled(criterion: Criterion, ask: Callable[[Criterion], FloatArray]) -> str:
    return _differ("after pickling", ask(criterion), ask(pickle.loads(pickle.dumps(criterion))), 0.0)


def _alone(criterion: Criterion, batches: list[Motions]) -> str:
    for motions in batches:
        together = motion_costs(criterion, motions)
        apart = np.concatenate([motion_costs(criterion, _part(motions, slice(i, i + 1))) for i in range(len(motions))])
        fault = _differ(f"a {motions.kind} alone", together, apart, 1e-9)
        if fault:
            return fault
    return ""


def _part(motions: Motions, index: slice) -> Motions:
    t0 = None if motions.t0 is None else motions.t0[index]
    return replace(motions, start=motions.start.take(index), end=motions.end.take(index), t0=t0)


def _cut(criterion: Criterion, rng: np.random.Generator, world: World, model: Model) -> str:
    """Curves, each a trajectory of one motion, against the same cut in two and in five."""
    m = random_motions(rng, world, model, "drive", 20)
    columns = {name: np.stack([getattr(m.start, name), getattr(m.end, name)], axis=1) for name in m.start.names}
    wholes = [Trajectory(model, States(**{n: c[i] for n, c in columns.items()}), (m.kind,)) for i in range(len(m))]
    expected = trajectory_costs([criterion], wholes, world)
    for pieces in (2, 5):
        apart = trajectory_costs([criterion], [whole.cut(np.array([pieces])) for whole in wholes], world)
        limits = (world.cell, 1.0) if criterion.aggregate == "max" else (CUT_TOLERANCE, None)
        fault = _differ(f"in {pieces} pieces", expected, apart, *limits)
        if fault:
            return fault
    return ""


def _halves(criterion: Criterion, batches: list[Motions]) -> str:
    for motions in (m for m in batches if m.kind == "move"):
        start, end = motions.start, motions.end
        middle = States(x=(start.x + end.x) / 2, y=(start.y + end.y) / 2, yaw=start.yaw)
        t_middle = motions.t0 + motions.duration / 2
        first = motion_costs(criterion, replace(motions, end=middle))
        second = motion_costs(criterion, replace(motions, start=middle, t0=t_middle))
        halves = np.maximum(first, second) if criterion.aggregate == "max" else first + second
        # A worst moment between two samples is missed by what the cost changes within a cell, in metres.
        limits = (motions.world.cell, 1.0) if criterion.aggregate == "max" else (SPLIT_TOLERANCE, None)
        fault = _differ("in two halves", motion_costs(criterion, motions), halves, *limits)
        if fault:
            return fault
    return ""


def _detour(model: Model, scale: float) -> Trajectory:
    """Moves and turns through the room, of its size or smaller."""
    poses = [(1, 1, 0), (3, 1, 0), (4, 5, np.pi), (1, 8, -2.0)]
    return Trajectory.from_poses(model, [(scale * x, scale * y, yaw) for x, y, yaw in poses])


def _slalom(model: Model) -> Trajectory:
    """Curves through the room from rest to rest: to the left, to the right, straight on, and about on the spot."""
    left, right = [(0.0, 2.0, 0.6), (0.0, 0.0, 0.4), (0.0, -2.0, 0.6)], [(0.0, -2.0, 0.6), (0.0, 2.0, 0.6)]
    on_the_spot = [(0.0, 3.0, 0.4), (0.0, -3.0, 0.4)]
    controls = [(1.0, 0.0, 0.8), *left, *right, (0.0, 0.0, 1.0), *right, *left, (-0.8, 0.0, 1.0), *on_the_spot]
    return driven(model, (1.0, 1.0, 0.2), controls)


def _as_edges(criterion: Criterion, world: World, model: Model) -> str:
    """Two trajectories' values against the sum (mean, maximum) over their motions, law by law."""
    for trajectory in (_detour(model, 1.0), _slalom(model)):
        costs = np.zeros(len(trajectory))
        for index, motions in trajectory.batches(world):
            # On a graph without time; a criterion that asks for the time is only defined on trajectories.
            costs[index] = motion_costs(criterion, replace(motions, t0=None))
        added = _added_up(criterion, costs, trajectory)
        fault = _differ("on the trajectory", added, _value(criterion, trajectory, world), 1e-9)
        if fault:
            return fault
    return ""


def _bounded(criterion: Any, world: World, model: Model) -> str:
    """A straight way, which a bound may meet, and detours, against the bound between their ends."""
    straight = Trajectory.from_poses(model, [(1.0, 1.0, 0.0), (3.0, 1.0, 0.0)])
    for trajectory in (straight, _slalom(model), *(_detour(model, scale) for scale in (0.3, 1.0))):
        ends = [trajectory.states.take(slice(i, i + 1)) for i in (0, len(trajectory))]
        bound, value = float(criterion.bound(*ends)[0]), trajectory_cost(criterion, trajectory, world)
        if not 0.0 <= bound <= value * (1 + 1e-9):
            return f"bound {bound:.6g} for a trajectory that costs {value:.6g}"
    return ""


def _walk(criterion: Criterion, rng: np.random.Generator, world: World) -> str:
    """Edges of a lattice on a random walk, evaluated among all others, against the walk as a trajectory."""
    lattice = StateLattice(
        make_model({"differential_drive": {"radius": 0.2}}), world, (0.5, 0.5), 0.5, Headings(8), False
    )
    edges = [(tails, heads, motion_costs(criterion, motions)) for tails, heads, motions in lattice.batches()]
    tails, heads, costs = (np.concatenate([edge[i] for edge in edges]) for i in range(3))
    state = int(rng.choice(tails))
    walk, paid = [state], []
    for _ in range(60):
        edge = int(rng.choice(np.flatnonzero(tails == state)))
        state = int(heads[edge])
        walk.append(state)
        paid.append(costs[edge])
    trajectory = lattice.trajectory(np.array(walk))
    added = _added_up(criterion, np.array(paid), trajectory)
    return _differ("along lattice edges", _value(criterion, trajectory, world), added, 1e-9)


def _added_up(criterion: Criterion, costs: FloatArray, trajectory: Trajectory) -> FloatArray:
    if criterion.aggregate == "max":
        return np.array([costs.max()])
    return np.array([costs.sum() / (trajectory.duration if criterion.aggregate == "time-mean" else 1.0)])


def _value(criterion: Criterion, trajectory: Trajectory, world: World) -> FloatArray:
    return np.array([trajectory_cost(criterion, trajectory, world)])


def _reframed(criterion: Criterion, world: World, model: Model) -> str:
    """World and trajectory turned and shifted together; fields lie on another grid then, hence the tolerance."""
    elsewhere = reframed(world)
    for trajectory in (_detour(model, 1.0), _slalom(model)):
        s = trajectory.states
        x, y = _turned(s.x, s.y)
        others = {name: getattr(s, name) for name in s.names[3:]}
        moved = Trajectory(model, States(x=x, y=y, yaw=s.yaw + FRAME[2], **others), trajectory.kinds)
        there = _value(criterion, moved, elsewhere)
        fault = _differ("in another frame", _value(criterion, trajectory, world), there, FRAME_TOLERANCE)
        if fault:
            return fault
    return ""


def reframed(world: World) -> World:
    """A polygon world turned and shifted by ``FRAME``, content and all."""

    def place(geometry: Any) -> Any:
        return shapely.transform(geometry, lambda points: np.stack(_turned(points[:, 0], points[:, 1]), axis=1))

    def pose(thing: Any, facing: str) -> dict[str, Any]:
        x, y = _turned(thing.x, thing.y)
        angle = getattr(thing, facing)
        return {"x": float(x), "y": float(y), facing: None if angle is None else angle + FRAME[2]}

    content = world.content
    return World.from_polygons(
        [(place(obstacle.polygon), obstacle.heights) for obstacle in world.obstacles], extent=place(world.extent)
    ).with_content(
        people=[replace(person, **pose(person, "yaw")) for person in content.people],
        groups=content.groups,
        landmarks=[replace(landmark, **pose(landmark, "facing")) for landmark in content.landmarks],
        zones=[
            replace(zone, area=place(zone.area), path=None if zone.path is None else place(zone.path))
            for zone in content.zones
        ],
    )


def _turned(x: Any, y: Any) -> tuple[Any, Any]:
    cos, sin = np.cos(FRAME[2]), np.sin(FRAME[2])
    return cos * x - sin * y + FRAME[0], sin * x + cos * y + FRAME[1]


class _SampledWorld(World):
    """A world whose clearance is the sampled field for numbers too, as it is for symbols: then both must be equal."""

    def clearance(self, x: Column, y: Column, *, z: tuple[float, float] = (-np.inf, np.inf)) -> Column:
        return self.clearance_field(z=z)(x, y)


def _symbolic(criterion: Criterion, batches: list[Motions]) -> str:
    from hpop.motions.symbolic import SymbolicMotions

    for motions in (replace(m, world=m.world.stand_in(_SampledWorld), panels=3) for m in batches):
        symbols = SymbolicMotions.of(motions)
        value, _ = symbols.values_and_jacobian(criterion.cost(symbols.motions))
        fault = _differ(f"a {motions.kind} on symbols", motion_costs(criterion, motions), value, 1e-6)
        if fault:
            return fault
    return ""


def _gradient(criterion: Criterion, batches: list[Motions]) -> str:
    from hpop.motions.symbolic import SymbolicMotions

    for motions in (replace(_part(m, slice(0, 4)), panels=3) for m in batches if len(m) > 1):
        symbols = SymbolicMotions.of(motions)
        function = symbols.function(criterion.cost(symbols.motions))
        value, jacobian = (np.array(part) for part in function(symbols.point))
        scale = max(float(np.abs(part).max()) for part in (value, jacobian))  # differences are as exact as the values
        for column, step in enumerate(GRADIENT_STEP * np.eye(symbols.point.size)):
            below, above = (np.array(function(symbols.point + ahead)[0]).ravel() for ahead in (-step, step))
            slope = (above - below) / (2 * GRADIENT_STEP)
            fault = _differ(
                f"d cost/d state of a {motions.kind}", slope, jacobian[:, column], GRADIENT_TOLERANCE, scale
            )
            if fault:
                return fault
    return ""
