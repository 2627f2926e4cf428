"""Conformance checks of a model in random worlds: the rules that criteria, planners and verification rely on."""

from __future__ import annotations

import json
import pickle
from collections.abc import Iterator

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column, FloatArray
from hpop.base.randomness import RNG, seed_of
from hpop.base.registry import make_model, with_optional_members
from hpop.base.text import shown
from hpop.errors import ModelError, UnsupportedModel
from hpop.models.base import PlanarModel
from hpop.motions import HOLD, MODEL_DEFAULTS, Law, Model, Motions, States, is_curve, laws_of, stands
from hpop.motions.by_law import STILL
from hpop.motions.laws import PACE, SPEED
from hpop.planners.needs import in_plane
from hpop.testing.contracts import (
    SAME,
    Check,
    axes_fault,
    axes_of,
    differ,
    extent_fault,
    fault_of,
    law_says,
    length_fault,
    model_says,
    raise_faults,
    twist_fault,
)
from hpop.testing.worlds import drawn_states, holds, random_motions, random_world
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

PAIRS = 12  # motions of each law
NEARER = 0.8  # share of the way to b in each draw after the first
DRAWS = 50  # of pairs of states, until enough of them are joinable
STATES = 200  # random states that are read and connected
JUDGED = 80  # random states, and random motions of each law, that are checked for collisions
MOST_TURN = 1.5  # rad, of a random arc
HELD = 2.0  # s, duration of the hold in a trajectory
NEAR = 0.15  # length of drawn motions, as a share of the distance to another state; short motions are often free
PASSED = 0.01  # m or rad: largest distance of an execution from the planned states as it passes them
BODIES = ("base", "camera", "tool")


@checked_arguments
def check_model(model: Model, *, rng: RNG = 0) -> None:
    """Raise ModelError with a list of all failed checks of a model; ``rng`` draws the worlds."""
    if isinstance(model, type) or not isinstance(model, Model):
        made = f"{model.__name__}()" if isinstance(model, type) else "DifferentialDrive()"
        raise ModelError(f"expected an instance of a model, such as {made}, got {shown(model)}")
    raise_faults(f"model {type(model).__name__}", model_checks(model, rng=rng), ModelError)


def model_checks(model: Model, *, rng: RNG = 0) -> Iterator[Check]:
    """Yield the checks of a model, one after the other; checks that need motions are skipped if its laws are faulty.

    Of the laws of curves, only "drive" and those of the plane that two poses determine are checked, since hpop cannot
    make random motions of others.
    """
    with_optional_members(model, MODEL_DEFAULTS)
    seed = seed_of(rng)
    random = np.random.default_rng(seed)
    world = random_world(random)
    yield Check("can be made again from its description", fault_of(lambda: _description_fault(model)))
    yield Check("reads and writes its states", fault_of(lambda: _space_fault(model, world, random)))
    yield Check("has everything that it says it provides", fault_of(lambda: _capability_fault(model, world)))
    yield Check("has valid optional attributes", fault_of(lambda: _attribute_fault(model, world, seed)))
    batches: list[Motions] = []
    led = Check("has laws that lead from start to end", fault_of(lambda: _laws_fault(model, world, random, batches)))
    yield led
    if led.fault:  # the other checks need motions
        return
    bodies = [name for name in BODIES if name in model.provides]
    yield Check("has poses with axes at right angles", fault_of(lambda: axes_fault(bodies, batches)))
    yield Check(
        "has twists that agree with the changes of its poses", fault_of(lambda: twist_fault(bodies, batches, random))
    )
    yield Check(
        "gives lengths and rotations of bodies that agree with their poses",
        fault_of(lambda: length_fault(bodies, batches)),
    )
    yield Check("moves no body farther than its extent", fault_of(lambda: extent_fault(bodies, batches)))
    yield Check(
        "has a collision test that accepts nothing its judge refuses",
        fault_of(lambda: _judge_fault(model, world, random)),
    )
    connected = Check(
        "connects states by motions that lead there", fault_of(lambda: _connection_fault(model, world, random))
    )
    yield connected
    if connected.fault:  # the other checks need trajectories of these motions
        return
    if model.provides >= {"plane", "turn-move"}:
        yield Check(
            "has stations that are joined by motions in place", fault_of(lambda: _stations_fault(in_plane(model)))
        )
    yield Check("executes a plan from its start to its end", fault_of(lambda: _execution_fault(model, world, random)))
    yield Check("finds no fault in its own trajectories", fault_of(lambda: _false_alarm(model, world, random)))


# Description and states


def _description_fault(model: Model) -> str:
    description = model.describe()
    again = make_model(json.loads(json.dumps(description, allow_nan=False)))
    if again.describe() != description:
        return f"it is described as {description}, but the model made from that as {again.describe()}"
    if (again, hash(again)) != (model, hash(model)):
        return f"the model made from {description} is not equal to the original, or has another hash"
    return "" if pickle.loads(pickle.dumps(model)) == model else "after pickling it is not equal to the original"


def _space_fault(model: Model, world: World, rng: np.random.Generator) -> str:
    space = model.space
    states = drawn_states(model, world, rng, STATES)
    if states.names != space.names:
        return f"samples of its space must have the states {space.names}, got {states.names}"
    for i in range(PAIRS):
        one = states.take(slice(i, i + 1))
        if space.values(space.state(space.values(one))) != space.values(one):
            return f"the state {space.values(one)} is read back as {space.values(space.state(space.values(one)))}"
    turned = States(**{n: getattr(states, n) + 2 * np.pi * (n in space.turning) for n in space.names})
    for body in (name for name in BODIES if name in model.provides):
        here, there = axes_of(model.pose(body, states), STATES), axes_of(model.pose(body, turned), STATES)
        if fault := differ(
            f"pose of the {body} after a full turn of {', '.join(space.turning)}", here, there, SAME, 10.0
        ):
            return fault
    return ""


def _capability_fault(model: Model, world: World) -> str:
    provides, names = model.provides, set(model.space.names)
    if not provides & set(BODIES):
        return f"provides must contain one of {', '.join(BODIES)}, whose poses criteria read, got {sorted(provides)}"
    if "plane" in provides:
        if not {"x", "y", "yaw"} <= names:
            return f"provides contains 'plane', so its states must include x, y and yaw, got {model.space.names}"
        for collision in (model.collision(world),):
            if not (hasattr(collision, "clear") and hasattr(collision, "yaw_matters")):
                return (
                    "provides contains 'plane', so its collision test must have clear() and yaw_matters, "
                    f"got {type(collision).__name__}"
                )
    if "rigid" in provides and names != {"x", "y", "yaw"}:
        return f"provides contains 'rigid', so its states must be x, y and yaw, got {model.space.names}"
    if "turn-move" in provides and not {"turn", "move"} <= set(model.laws):
        return f"provides contains 'turn-move', so its laws must include turn and move, got {', '.join(model.laws)}"
    return ""


def _attribute_fault(model: Model, world: World, seed: int) -> str:
    own = np.random.default_rng((seed, 1))  # a separate generator, so that a seed still draws the same other checks
    return model_says(model, world, drawn_states(model, world, own, STATES))


# Motions


def drawn_pairs(model: Model, world: World, rng: np.random.Generator, size: int) -> tuple[States, States]:
    """Return random states a and b (size,), such that the model can join each a to its b (``model.joinable``).

    In each of up to DRAWS rounds, ``size`` random pairs are drawn, and those that can be joined are kept. If time is a
    state of the model, each round draws b nearer to a than the round before, so that the robot gets from a to b in the
    time between them. Raises ModelError if all rounds together give fewer than ``size`` pairs.
    """
    names, drawn = model.space.names, 0
    pairs: list[FloatArray] = []
    for draw in range(DRAWS):
        a, b = (drawn_states(model, world, rng, size) for _ in range(2))
        if draw and "time" in model.provides:
            change = model.space.differences(a, b)
            nearer = {name: getattr(a, name) + NEARER**draw * change[name] for name in names[:-1]}
            b = States(**b.__dict__ | nearer)
        pairs.append(np.array([[getattr(end, name) for end in (a, b)] for name in names])[..., model.joinable(a, b)])
        if (drawn := drawn + pairs[-1].shape[-1]) >= size:
            columns = dict(zip(names, np.concatenate(pairs, axis=-1)[..., :size], strict=True))
            ends = [States(**{name: column[end] for name, column in columns.items()}) for end in (0, 1)]
            return ends[0], ends[1]
    raise ModelError(
        f"expected some joinable pairs among {DRAWS * size} of random states, found {drawn} of the {size} that are "
        "needed; give the robot more time, or check joinable()"
    )


def drawn_motions(
    model: Model, kind: str, world: World, rng: np.random.Generator, size: int, share: float = 1.0
) -> Motions | None:
    """Return random motions (size,) of a law, or None for a law of curves of which hpop cannot make random motions.

    share  length of each motion, as a share of the distance to another random state
    """
    law, space = laws_of(model)[kind], model.space
    if stands(law):
        return holds(world, model, drawn_states(model, world, rng, size), rng)
    if is_curve(law):
        if law.varies - {PACE} == {"x", "y", "yaw"} and not set(law.extra) - {PACE}:
            return _drawn_arcs(model, law, world, rng, size, share)
        return random_motions(rng, world, model, kind, size) if kind == "drive" else None
    start, other = drawn_pairs(model, world, rng, size)
    changes, ones = space.differences(start, other), np.ones(size)
    end = States(**{n: getattr(start, n) + share * changes[n] * (n in law.varies) for n in space.names})
    # A law may change states together (a head turns back while its base turns), which determines where it can end.
    led = {n: law.interpolate(n, start, end, ones) if n in law.varies else getattr(end, n) for n in space.names}
    end = States(**led)
    if SPEED in law.extra:
        speeds = rng.permutation(np.resize(model.speed_classes, 2 * size)).reshape(2, size)
        before, after = speeds if SPEED in law.varies else speeds[[0, 0]]
        start, end = States(**start.__dict__ | {SPEED: before}), States(**led | {SPEED: after})
    if PACE in law.extra:
        before, after = rng.uniform(0.1, 1.0, (2, size))
        start, end = States(**start.__dict__ | {PACE: before}), States(**led | {PACE: after})
    return Motions(world, model, law, start, end, t0=np.zeros(size))


def _drawn_arcs(model: Model, law: Law, world: World, rng: np.random.Generator, size: int, share: float) -> Motions:
    """Return random motions (size,) along arcs, for a law of curves that the poses at their ends determine."""
    start, other = drawn_pairs(model, world, rng, size)
    turn = rng.uniform(-MOST_TURN, MOST_TURN, size)
    chord, ahead = share * np.hypot(other.x - start.x, other.y - start.y), start.yaw + 0.5 * turn
    end = {"x": start.x + chord * np.cos(ahead), "y": start.y + chord * np.sin(ahead), "yaw": start.yaw + turn}
    paces = {PACE: rng.uniform(0.1, 1.0, size)} if PACE in law.extra else {}
    faster = {PACE: rng.uniform(0.1, 1.0, size)} if PACE in law.extra else {}
    begin, stop = States(**start.__dict__ | paces), States(**start.__dict__ | end | faster)
    return Motions(world, model, law, begin, stop, t0=np.zeros(size))


def _laws_fault(model: Model, world: World, rng: np.random.Generator, batches: list[Motions]) -> str:
    """Return a fault in the ends or phases of laws, else ""; add motions to ``batches``, for the other checks."""
    if HOLD.kind in model.laws:
        return f"no law may be called {HOLD.kind!r}, because hpop adds this law to every model; choose another name"
    for kind, law in laws_of(model).items():
        if law.kind != kind:
            return f"the law with the key {kind!r} must have this kind, got {law.kind!r}"
        motions = drawn_motions(model, kind, world, rng, PAIRS)
        if motions is None:
            continue
        if strange := law.varies - set(motions.start.names):
            return f"varies of a {kind} must hold names of its states, got {', '.join(sorted(strange))}"
        start, end, ones, half = motions.start, motions.end, np.ones(PAIRS), np.full(PAIRS, 0.5)
        for name in law.varies:
            for share, states in ((0.0, start), (1.0, end)):
                found = law.interpolate(name, start, end, share * ones)
                if fault := differ(f"{name} of a {kind} at {share:.0%}", getattr(states, name), found, 1e-6, 1.0):
                    return fault
            # Collision tests and integrals assume that other laws change states linearly with the share.
            if is_curve(law) or name in (SPEED, PACE):
                continue
            middle, found = 0.5 * (getattr(start, name) + getattr(end, name)), law.interpolate(name, start, end, half)
            if fault := differ(f"{name} halfway through a {kind}, which is no curve", middle, found, 1e-6, 1.0):
                return fault
        done: Column = 0.0 * ones
        for phase in motions.phases:
            lasts = phase.duration + 0.0 * ones
            if not (np.isfinite(lasts).all() and (lasts >= 0).all()):
                return f"the phases of a {kind} must have finite durations >= 0 s, got {lasts.min()}"
            if fault := differ(f"begin of a phase of a {kind}", done, phase.begin + 0.0 * ones, SAME, 1.0):
                return fault
            done = phase.end + 0.0 * ones
        if fault := differ(f"end of the last phase of a {kind}", ones, done, SAME, 1.0):
            return fault
        if fault := law_says(motions):
            return fault
        batches.append(motions)
    return "" if batches else "hpop can draw motions of none of its laws, so they cannot be checked"


def _judge_fault(model: Model, world: World, rng: np.random.Generator) -> str:
    """Return a fault if the model's ``collision`` and ``judge``, its exact test, contradict each other; "" otherwise.

    States and motions that ``collision`` frees must be free by ``judge``, and it must free at least half of those that
    ``judge`` frees. In each of the two, ``why_blocked`` must give a reason for blocked states only.
    """
    collision, judge = model.collision(world), model.judge(world)
    states = drawn_states(model, world, rng, JUDGED)
    answers = [("states", collision.states_free(states), judge.states_free(states))]
    for kind in model.laws:  # a hold is free if its state is
        motions = drawn_motions(model, kind, world, rng, JUDGED, NEAR)
        if motions is not None:
            answers.append((f"motions of the law {kind}", collision.motions_free(motions), judge.motions_free(motions)))
    for what, planned, judged in answers:
        if (planned & ~judged).any():
            return f"{(planned & ~judged).sum()} of {planned.size} {what} are free by collision(), but not by judge()"
        if 2 * planned.sum() < judged.sum():
            return f"of {judged.sum()} {what} that are free by judge(), only {planned.sum()} are free by collision()"
    for i in range(PAIRS):
        one = states.take(slice(i, i + 1))
        for name, asked in (("collision", collision), ("judge", judge)):
            reason, is_free = asked.why_blocked(one), bool(asked.states_free(one)[0])
            if bool(reason) == is_free:
                return f"why_blocked() of its {name} returns {reason!r} for a {'free' if is_free else 'blocked'} state"
    return ""


# Trajectories


def _connection_fault(model: Model, world: World, rng: np.random.Generator) -> str:
    space = model.space
    a, b = drawn_pairs(model, world, rng, STATES)
    number = np.arange(STATES)  # every fifth stays in place, every seventh has free angles
    columns = {n: np.where(number % 5 > 0, getattr(b, n), getattr(a, n)) for n in space.names}
    columns |= {n: np.where(number % 7 > 0, columns[n], np.nan) for n in space.angles}
    b, here = States(**columns), a
    for leg in model.connect(a, b):
        if leg.kind not in model.laws:
            return f"connect() must return motions of the laws {', '.join(model.laws)}, got {leg.kind!r}"
        changes = {n: np.abs(getattr(leg.end, n) - getattr(here, n)) for n in space.names}
        for name, change in changes.items():
            if np.isnan(change).any():
                return f"{name} is nan at the end of a {leg.kind}; if b leaves it free, connect() must choose a value"
            if change[~leg.present].max(initial=0.0) > SAME:
                return f"a {leg.kind} that is not present changes {name} by {change[~leg.present].max():.3g}"
            if name not in model.laws[leg.kind].varies and change.max() > STILL:
                return f"a {leg.kind} changes {name} by {change.max():.3g}, but its law does not vary {name}"
            if name in space.turning and change.max() > np.pi + SAME:
                return (
                    f"a {leg.kind} changes {name} by {change.max():.3g} rad, more than half a turn; turn the other way"
                )
        here = leg.end
    missed = max(float(np.nanmax(np.abs(miss))) for miss in space.differences(b, here).values())
    return f"the motions end {missed:.3g} m or rad from the requested states" if missed > STILL else ""


def _tour(model: Model, world: World, rng: np.random.Generator) -> Trajectory:
    """Return a trajectory with a hold through random states, which the model connects.

    For a model with time as a state, it goes from the first time to the last, between two joinable states, with waits.
    """
    if "time" in model.provides:
        return Trajectory.through(model, _in_time(model, *drawn_pairs(model, world, rng, 1)))
    through = Trajectory.through(model, drawn_states(model, world, rng, 5))
    rests = np.flatnonzero(getattr(through.states, SPEED, np.zeros(len(through) + 1)) == 0.0)
    return through.with_hold(at=int(rests[rests.size // 2]), seconds=HELD)


def _in_time(model: Model, a: States, b: States) -> States:
    """Return four states (4,): a at the first time, a, b, and b at the last time; a and b are single states (1,)."""
    space, time = model.space, model.space.names[-1]
    times = [space.low[-1], getattr(a, time), getattr(b, time), space.high[-1]]
    columns = {name: [getattr(a, name)] * 2 + [getattr(b, name)] * 2 for name in space.names}
    return States(**{name: np.hstack(parts) for name, parts in (columns | {time: times}).items()})


def _stations_fault(model: PlanarModel) -> str:
    """Return a fault of the stations (states at one position) for four headings, or of their motions; "" otherwise."""
    yaw: FloatArray = np.linspace(0.0, 1.5 * np.pi, 4)
    space = model.space
    try:
        states, headings, motions = model.stations(yaw)
    except UnsupportedModel:  # lattices do not support this model
        return ""
    if fault := differ("yaws of stations", yaw[headings], states.yaw, SAME, 1.0):
        return fault
    for kind, (tails, heads) in motions.items():
        law, start, wanted = model.laws[kind], states.take(tails), states.take(heads)
        if moved := law.varies & {"x", "y"}:
            return f"motions between stations must stay in place, but a {kind} varies {', '.join(sorted(moved))}"
        end, ones = space.onward(start, wanted), np.ones(tails.size)
        led = {n: law.interpolate(n, start, end, ones) if n in law.varies else getattr(start, n) for n in space.names}
        for name, miss in space.differences(wanted, States(**led)).items():
            if fault := differ(f"error in {name} after a {kind} in place", 0.0 * ones, miss, STILL, 1.0):
                return fault
    return ""


def _execution_fault(model: Model, world: World, rng: np.random.Generator) -> str:
    space = model.space
    for _ in range(PAIRS):
        planned = _tour(model, world, rng)
        done, passed = model.execution(planned)
        for place, what in ((0, "begins"), (-1, "ends")):
            there, wanted = done.states.take([place]), planned.states.take([place])
            missed = max(float(np.abs(miss).max()) for miss in space.differences(wanted, there).values())
            if missed > STILL:
                return f"the execution {what} {missed:.3g} m or rad from the plan"
        if np.shape(passed) != planned.times.shape or not (np.diff(passed) >= 0).all():
            return f"the times of passing {len(planned) + 1} planned states must not decrease, got {passed}"
        if not np.isclose(passed[-1], done.duration, rtol=SAME, atol=SAME):
            return f"the execution lasts {done.duration:.6g} s, but passes the last state at {passed[-1]:.6g} s"
        missed = max(float(np.abs(miss).max()) for miss in space.differences(planned.states, done.at(passed)).values())
        if missed > PASSED:
            return f"the execution is {missed:.3g} m or rad from a planned state at the time given for passing it"
    return ""


def _false_alarm(model: Model, world: World, rng: np.random.Generator) -> str:
    for _ in range(PAIRS):
        planned = _tour(model, world, rng)
        for what, trajectory in (("planned", planned), ("executed", planned.execution())):
            for fault in model.faults(trajectory):
                return f"by faults(), the {what} trajectory {fault}"
    return ""
