"""Conformance checks of a criterion, on motions in random worlds: the rules that planners and fronts rely on."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column, FloatArray, IntArray
from hpop.base.randomness import RNG, seed_of
from hpop.base.registry import make_model, with_optional_members
from hpop.base.text import shown
from hpop.criteria.base import CRITERION_DEFAULTS, Criterion
from hpop.criteria.costs import motion_costs, running_costs, trajectory_cost, trajectory_costs
from hpop.errors import CriterionError
from hpop.models.driven import driven
from hpop.motions import HOLD, Model, Motions, States
from hpop.planners.graphs.lattice.graph import StateLattice
from hpop.planners.graphs.lattice.grid import Headings
from hpop.testing.contracts import Check, as_trajectories, criterion_says, differ, fault_of, raise_faults
from hpop.testing.models import drawn_motions
from hpop.testing.worlds import (
    FRAME,
    in_frame,
    jumps_across,
    predicted_batches,
    prediction_checks,
    random_motions,
    random_world,
    reframed,
    wide_motions,
    wide_world,
)
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

if TYPE_CHECKING:
    from hpop.motions.symbolic import SymbolicMotions

ABOUT_PEOPLE = {"people", "groups"}
KINDS = ("move", "turn", "drive")
OF_HEAD = ("move", "turn", "pan", "tilt", "unwind")
SIZES = (1, 40)  # of batches
IN_HALVES = ("move", HOLD.kind)
HELD = 1.5  # s, duration of the hold in a tour
NEAR = 0.3  # length of drawn motions, as a share of the distance to another random state
LEAST_CHANGE = 0.1  # m or rad: drawn motions that change less are skipped
CUT_TOLERANCE = 5e-3  # relative, for a curve: costs may jump where a wheel begins to turn the other way
SPLIT_TOLERANCE = 2e-3  # relative: difference between two quadratures of one integral
ALONE = 8  # every eighth motion is evaluated alone
DIFFERENTIATED = 4  # motions of each batch; among many motions, one would lie at a kink
GRADIENT_STEP = 1e-5  # m or rad, of the central difference
GRADIENT_TOLERANCE = 1e-3
WIDELY = 400  # motions at positions and speeds of all magnitudes
GRADUALLY = "let it rise gradually, such as np.clip((x - limit) / width, 0.0, 1.0)"
FRAME_TOLERANCE = 0.03  # relative: distance fields with cells of 0.1 m are sampled on another grid


@checked_arguments
def check_criterion(criterion: Criterion, *, rng: RNG = 0) -> None:
    """Raise CriterionError with a list of all failed checks of a criterion; ``rng`` draws the worlds."""
    if isinstance(criterion, type) or not isinstance(criterion, Criterion):
        made = f"{criterion.__name__}()" if isinstance(criterion, type) else "Turns()"
        raise CriterionError(f"expected an instance of a criterion, such as {made}, got {shown(criterion)}")
    raise_faults(f"criterion {criterion.name!r}", criterion_checks(criterion, rng=rng), CriterionError)


def criterion_checks(criterion: Criterion, *, rng: RNG = 0) -> Iterator[Check]:
    """Yield the checks of a criterion, one after the other.

    If its declarations or its costs are invalid, the checks end there. A criterion that requires joints is checked on a
    base with a pan-tilt head, without curves and lattices.
    """
    with_optional_members(criterion, CRITERION_DEFAULTS)
    seed = seed_of(rng)
    random = np.random.default_rng(seed)
    base: dict[str, Any] = {"differential_drive": {"camera_offset": (0.1, 0.05), "seat": (0.1, -0.05, 0.6)}}
    jointed = "joints" in criterion.requires
    model = make_model({"pan_tilt": {"base": base}} if jointed else base)
    world = random_world(random)
    wide = wide_world(world)
    tours = [_head_tour(model)] if jointed else [_detour(model, 1.0), _slalom(model)]
    if criterion.aggregate == "trajectory":
        trajectories = tours if jointed else [_detour(model, 0.3), *tours]

        def ask(asked: Criterion) -> FloatArray:
            return np.concatenate([running_costs(asked, trajectory, world) for trajectory in trajectories])

        def wide_costs() -> None:
            for scale in () if jointed else (-1.0, -4.0, 5.0):
                running_costs(criterion, _detour(model, scale), wide)

    else:
        kinds, drawn = (OF_HEAD, _linear_motions) if jointed else (KINDS, random_motions)
        batches = [drawn(random, world, model, kind, size) for kind in kinds for size in SIZES]
        standing = np.random.default_rng((seed, 1))  # a separate generator, so that a seed still draws the same motions
        batches += [drawn(standing, world, model, HOLD.kind, size) for size in SIZES]

        def ask(asked: Criterion) -> FloatArray:
            return np.concatenate([motion_costs(asked, motions) for motions in batches])

        def wide_costs() -> None:
            spread = np.random.default_rng((seed, 2))
            if jointed:
                others = [drawn(spread, wide, model, kind, SIZES[-1]) for kind in kinds]
            else:
                others = wide_motions(spread, wide, model, WIDELY)
            for motions in others:
                motion_costs(criterion, motions)

    declared = Check("has valid declarations", fault_of(lambda: criterion_says(criterion)))
    yield declared
    if declared.fault:
        return
    first: list[FloatArray] = []  # the first costs, for comparisons

    def costs() -> str:
        first.append(ask(criterion))
        wide_costs()
        return "" if first[0].size else "no costs"

    finite = Check("costs a finite number >= 0 for each motion", fault_of(costs))
    yield finite
    if finite.fault:  # the other checks compare costs, so all of them would fail
        return
    (before,) = first
    yield Check(
        "gives the same costs after pickling",
        fault_of(lambda: differ("after pickling", before, ask(pickle.loads(pickle.dumps(criterion))), 0.0)),
    )
    yield Check(
        "gives the same costs when evaluated again",
        fault_of(lambda: differ("in the second evaluation", before, ask(criterion), 0.0)),
    )
    if (stand_in := criterion.integral) is not None:
        yield Check(
            "has an integral that costs each motion the same",
            fault_of(lambda: differ(f"{stand_in.name} of a motion", before, ask(stand_in), 1e-9)),
        )
    if not criterion.world_frame:
        yield Check("costs the same in any frame of the world", fault_of(lambda: _frame_fault(criterion, world, tours)))
    if criterion.bound is not None:
        yield Check(
            "bounds the cost of every trajectory from below", fault_of(lambda: _bound_fault(criterion, world, model))
        )
    if criterion.aggregate == "trajectory":
        return
    yield Check(
        "costs the same on a trajectory as on its edges", fault_of(lambda: _edges_fault(criterion, world, tours))
    )
    if not jointed:
        yield Check(
            "adds up along lattice edges to the trajectory's cost",
            fault_of(lambda: _lattice_fault(criterion, random, world)),
        )
    yield Check("costs a motion the same alone and in a batch", fault_of(lambda: _batch_fault(criterion, batches)))
    yield Check(
        "costs the two halves of a move or hold as much as the whole",
        fault_of(lambda: _halves_fault(criterion, batches)),
    )
    if not jointed:
        yield Check(
            "costs the same wherever a curve is cut",
            fault_of(lambda: _pieces_fault(criterion, random_motions(random, world, model, "drive", 12))),
        )
        if criterion.aggregate != "max":
            yield Check("has a rate without jumps", fault_of(lambda: _jump_fault(criterion, seed, wide, model)))
    if criterion.smooth:
        functions = cache(lambda: list(_on_symbols(criterion, batches)))
        yield Check("has the same value on CasADi symbols", fault_of(lambda: _symbols_fault(criterion, functions)))
        yield Check("has a gradient that agrees with finite differences", fault_of(lambda: _gradient_fault(functions)))
    if not jointed and ABOUT_PEOPLE & set(criterion.requires):
        yield from prediction_checks(criterion, world, batches)
        if criterion.smooth:
            walked = cache(lambda: list(_on_symbols(criterion, predicted_batches(criterion, world, batches))))
            yield Check(
                "has the same value on CasADi symbols where people walk",
                fault_of(lambda: _symbols_fault(criterion, walked)),
            )
            yield Check(
                "has a gradient that agrees with finite differences where people walk",
                fault_of(lambda: _gradient_fault(walked)),
            )


def _batch_fault(criterion: Criterion, batches: list[Motions]) -> str:
    for motions in batches:
        some = range(0, len(motions), ALONE)
        together = motion_costs(criterion, motions)[::ALONE]
        apart = np.concatenate([motion_costs(criterion, _subset(motions, slice(i, i + 1))) for i in some])
        fault = differ(f"a {motions.kind} alone", together, apart, 1e-9)
        if fault:
            return fault
    return ""


def _subset(motions: Motions, index: slice | IntArray) -> Motions:
    t0 = None if motions.t0 is None else motions.t0[index]
    return replace(motions, start=motions.start.take(index), end=motions.end.take(index), t0=t0)


def _pieces_fault(criterion: Criterion, m: Motions) -> str:
    """Return a fault if the costs of curves (trajectories of one motion) change when they are cut in two or in five."""
    wholes = list(as_trajectories(m))
    expected = trajectory_costs([criterion], wholes, m.world)
    for pieces in (2, 5):
        apart = trajectory_costs([criterion], [whole.cut(np.array([pieces])) for whole in wholes], m.world)
        limits = (m.world.cell, 1.0) if criterion.aggregate == "max" else (CUT_TOLERANCE, None)
        fault = differ(f"in {pieces} pieces", expected, apart, *limits)
        if fault:
            return fault
    return ""


def _jump_fault(criterion: Criterion, seed: int, wide: World, model: Model) -> str:
    """Return a fault if a rate jumps, so that motions across the jump cost another amount in pieces; "" otherwise."""
    for jump, motions in jumps_across(criterion, np.random.default_rng((seed, 3)), wide, model):
        if fault := _pieces_fault(criterion, motions):
            return f"{jump}; the cost of a {motions.kind} across it, {fault}; {GRADUALLY}"
    return ""


def _halves_fault(criterion: Criterion, batches: list[Motions]) -> str:
    for motions in (m for m in batches if m.kind in IN_HALVES):
        start, end = motions.start, motions.end
        middle = States(**{name: (getattr(start, name) + getattr(end, name)) / 2 for name in start.names})
        t_middle = motions.t0 + motions.duration / 2
        first = motion_costs(criterion, replace(motions, end=middle))
        second = motion_costs(criterion, replace(motions, start=middle, t0=t_middle))
        halves = np.maximum(first, second) if criterion.aggregate == "max" else first + second
        # The worst moment may lie between two samples; the error is the change of the cost within a cell.
        limits = (motions.world.cell, 1.0) if criterion.aggregate == "max" else (SPLIT_TOLERANCE, None)
        fault = differ("in two halves", motion_costs(criterion, motions), halves, *limits)
        if fault:
            return fault
    return ""


def _detour(model: Model, scale: float) -> Trajectory:
    """Return a trajectory of moves and turns in place with a hold, scaled from the size of the room."""
    poses = [(1, 1, 0), (3, 1, 0), (4, 5, np.pi), (1, 8, -2.0)]
    tour = Trajectory.from_poses(model, [(scale * x, scale * y, yaw) for x, y, yaw in poses])
    return tour.with_hold(at=3, seconds=HELD)


def _slalom(model: Model) -> Trajectory:
    """Return a trajectory of curves through the room, from rest to rest: left, right, straight on, turns in place."""
    left, right = [(0.0, 2.0, 0.6), (0.0, 0.0, 0.4), (0.0, -2.0, 0.6)], [(0.0, -2.0, 0.6), (0.0, 2.0, 0.6)]
    on_the_spot = [(0.0, 3.0, 0.4), (0.0, -3.0, 0.4)]
    controls = [(1.0, 0.0, 0.8), *left, *right, (0.0, 0.0, 1.0), *right, *left, (-0.8, 0.0, 1.0), *on_the_spot]
    return driven(model, (1.0, 1.0, 0.2), controls)


def _head_tour(model: Model) -> Trajectory:
    """Return a trajectory through the room with a hold, in which the head pans and tilts."""
    rows = [(1, 1, 0, 0, 0), (3, 1, 0, 1.0, 0.3), (4, 5, np.pi, -0.5, 0.3), (1, 8, -2.0, -1.2, -0.4)]
    through = States(**dict(zip(model.space.names, np.array(rows, float).T, strict=True)))
    return Trajectory.through(model, through).with_hold(at=4, seconds=HELD)


def _linear_motions(rng: np.random.Generator, world: World, model: Model, kind: str, size: int) -> Motions:
    """Return random motions of a law that changes its states linearly.

    Very short motions are left out, because their costs are smoothed on symbols.
    """
    motions = drawn_motions(model, kind, world, rng, 20 * size, NEAR)
    assert motions is not None
    if motions.stands:
        return _subset(motions, slice(size))
    return _subset(motions, np.flatnonzero(np.maximum(*model.extent(motions)) > LEAST_CHANGE)[:size])


def _edges_fault(criterion: Criterion, world: World, tours: list[Trajectory]) -> str:
    """Return a fault if a trajectory's cost is not the sum, time-mean or maximum of its motions' costs; else ""."""
    for trajectory in tours:
        costs = np.zeros(len(trajectory))
        for index, motions in trajectory.batches(world):
            # A graph has no time, and a criterion that reads the time is defined on trajectories only.
            costs[index] = motion_costs(criterion, replace(motions, t0=None))
        added = _sum_of_edges(criterion, costs, trajectory)
        fault = differ("on the trajectory", added, _trajectory_value(criterion, trajectory, world), 1e-9)
        if fault:
            return fault
    return ""


def _bound_fault(criterion: Any, world: World, model: Model) -> str:
    """Return a fault if the criterion's lower bound is negative, or exceeds the cost of a trajectory; "" otherwise.

    The trajectories are a straight one, for which bound and cost may be equal, a slalom, and detours.
    """
    straight = Trajectory.from_poses(model, [(1.0, 1.0, 0.0), (3.0, 1.0, 0.0)])
    for trajectory in (straight, _slalom(model), *(_detour(model, scale) for scale in (0.3, 1.0))):
        ends = [trajectory.states.take(slice(i, i + 1)) for i in (0, len(trajectory))]
        bound, value = float(criterion.bound(*ends)[0]), trajectory_cost(criterion, trajectory, world)
        if not 0.0 <= bound <= value * (1 + 1e-9):
            return f"bound() must be at most the cost {value:.6g} of a trajectory, and at least 0, got {bound:.6g}"
    return ""


def _lattice_fault(criterion: Criterion, rng: np.random.Generator, world: World) -> str:
    """Return a fault if the edges of a random walk on a lattice cost more or less than the trajectory along them."""
    lattice = StateLattice(
        make_model({"differential_drive": {"radius": 0.2, "seat": (0.1, -0.05, 0.6)}}),
        world,
        (0.5, 0.5),
        0.5,
        Headings(8),
        False,
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
    added = _sum_of_edges(criterion, np.array(paid), trajectory)
    return differ("along lattice edges", _trajectory_value(criterion, trajectory, world), added, 1e-9)


def _sum_of_edges(criterion: Criterion, costs: FloatArray, trajectory: Trajectory) -> FloatArray:
    if criterion.aggregate == "max":
        return np.array([costs.max()])
    return np.array([costs.sum() / (trajectory.duration if criterion.aggregate == "time-mean" else 1.0)])


def _trajectory_value(criterion: Criterion, trajectory: Trajectory, world: World) -> FloatArray:
    return np.array([trajectory_cost(criterion, trajectory, world)])


def _frame_fault(criterion: Criterion, world: World, tours: list[Trajectory]) -> str:
    """Return a fault if costs change when world and trajectory are rotated and shifted together; "" otherwise."""
    elsewhere = reframed(world)
    for trajectory in tours:
        s = trajectory.states
        x, y = in_frame(s.x, s.y)
        others = {name: getattr(s, name) for name in s.names[3:]}
        moved = Trajectory(trajectory.model, States(x=x, y=y, yaw=s.yaw + FRAME[2], **others), trajectory.kinds)
        there = _trajectory_value(criterion, moved, elsewhere)
        fault = differ("in another frame", _trajectory_value(criterion, trajectory, world), there, FRAME_TOLERANCE)
        if fault:
            return f"{fault}; if a parameter or a number in the code is a place of the map, declare world_frame=True"
    return ""


class _SampledWorld(World):
    """World that always takes the clearance from the sampled field.

    Symbolic evaluation can only use this field, so that numeric and symbolic costs must then be equal.
    """

    def clearance(self, x: Column, y: Column, *, z: tuple[float, float] = (-np.inf, np.inf)) -> Column:
        return self.clearance_field(z=z)(x, y)


def _on_symbols(criterion: Criterion, batches: list[Motions]) -> Iterator[tuple[Motions, SymbolicMotions, Any]]:
    """Yield, for each batch, its motions, their symbols, and the function from states to costs and their Jacobian."""
    from hpop.motions.symbolic import SymbolicMotions  # imports casadi

    for motions in (replace(m, world=m.world.stand_in(_SampledWorld), panels=1) for m in batches):
        symbols = SymbolicMotions.of(motions)
        yield motions, symbols, symbols.function(criterion.cost(symbols.motions))


def _symbols_fault(criterion: Criterion, functions: Callable[[], list[tuple[Motions, SymbolicMotions, Any]]]) -> str:
    for motions, symbols, function in functions():
        value = np.array(function(symbols.point)[0]).ravel()
        fault = differ(f"a {motions.kind} on symbols", motion_costs(criterion, motions), value, 1e-6)
        if fault:
            return fault
    return ""


def _gradient_fault(functions: Callable[[], list[tuple[Motions, SymbolicMotions, Any]]]) -> str:
    """Return a fault if a derivative by a coordinate of the start or end states differs from finite differences.

    Only the first few motions of each batch are checked, and batches of one motion are left out.
    """
    for motions, symbols, function in (one for one in functions() if len(one[0]) > 1):
        value, jacobian = (np.array(part)[:DIFFERENTIATED] for part in function(symbols.point))
        slopes = jacobian.reshape(len(value), -1, len(motions)).sum(axis=2)  # (M, states)
        least = GRADIENT_STEP / GRADIENT_TOLERANCE  # near a kink, differences are as inexact as their step
        scale = max(least, *(float(np.abs(part).max()) for part in (value, jacobian)))  # and as the values
        for column, found in enumerate(slopes.T):
            step = GRADIENT_STEP * np.repeat(np.arange(slopes.shape[1]) == column, len(motions))
            below, above = (np.array(function(symbols.point + ahead)[0])[: len(value), 0] for ahead in (-step, step))
            slope = (above - below) / (2 * GRADIENT_STEP)
            fault = differ(f"d cost/d state of a {motions.kind}", slope, found, GRADIENT_TOLERANCE, scale)
            if fault:
                return fault
    return ""
