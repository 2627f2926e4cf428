"""Evaluation of criteria on motions and whole trajectories, and the quanta (smallest differences) of costs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.options import MOST, real
from hpop.base.registry import with_optional_members
from hpop.base.text import shown
from hpop.criteria.base import Criterion, check_command, check_requirements, class_of
from hpop.errors import CriterionError, HpopError, UnsupportedCriterion, did_you_mean, own_failure
from hpop.motions import MODEL_DEFAULTS, Motions, laws_of
from hpop.motions.by_law import batches
from hpop.runtime.limits import LimitPassed
from hpop.trajectories.history import History
from hpop.trajectories.motion_table import BLOCK, MotionTable
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.criteria.performance.landmarks import StopsMissed
    from hpop.world import World

PROGRESS_EVERY = 100  # number of trajectories between two progress reports
FINEST = 1e-12  # smallest quantum, in the unit of a cost; exact searches also refuse quanta by which sums overflow
C = TypeVar("C", bound=Criterion)


@checked_arguments
def motion_costs(criterion: Criterion, motions: Motions) -> FloatArray:
    """Return the cost (M,) of each motion by a criterion, and check that it is one finite number >= 0.

    Raises CriterionError, which names the criterion, the kind of motion and the first wrong value. An error in the
    ``cost`` method of a user's criterion becomes a CriterionError that says where it was raised. For an empty batch,
    ``cost`` is not called.
    """
    if not len(motions):
        check_requirements(criterion, motions.model, motions.world)
        return np.zeros(0)
    return _checked_costs(criterion, motions, len(motions), motions.kind)


def _checked_costs(criterion: Criterion, m: Motions | History, size: int, kind: str) -> FloatArray:
    """Call a criterion's ``cost`` and check the result: ``size`` finite numbers >= 0.

    ``kind`` names the kind of motions in errors.
    """
    laws_of(with_optional_members(m.model, MODEL_DEFAULTS))  # adds the defaults of optional members to the laws too
    check_requirements(criterion, m.model, m.world)
    try:
        costs = np.asarray(criterion.cost(m))
    except UnsupportedCriterion as error:
        raise UnsupportedCriterion(f"criterion {criterion.name!r} cannot be used here: {error}") from None
    except (HpopError, MemoryError, LimitPassed):
        raise
    except Exception as error:  # a user's criterion may raise anything; a failure of hpop's own is a bug
        if class_of(criterion).__module__.startswith("hpop."):
            raise
        failure = CriterionError(own_failure(f"criterion {criterion.name!r}", error))
        failure.add_note(f"to test the criterion, run `{check_command(criterion)}`")
        raise failure from error
    if costs.shape != (size,):
        raise CriterionError(
            f"criterion {criterion.name!r} must return one cost for each motion, shape ({size},), "
            f"for {kind!r} motions; it returned shape {costs.shape}"
        )
    if not (np.can_cast(costs.dtype, np.float64, "same_kind")):
        raise CriterionError(f"criterion {criterion.name!r} must return numbers, got dtype {costs.dtype}")
    costs = costs.astype(np.float64)
    wrong = ~(costs >= 0) | np.isinf(costs)
    if wrong.any():
        value = costs[np.argmax(wrong)]
        raise CriterionError(
            f"criterion {criterion.name!r} must cost a finite number >= 0, but {int(wrong.sum())} of {size} "
            f"{kind!r} motions cost {value}; shift or clip it in cost()"
        )
    return costs


@checked_arguments
def trajectory_cost(criterion: Criterion, trajectory: Trajectory, world: World) -> float:
    """Return the cost of one trajectory by one criterion; see :func:`trajectory_costs`."""
    return float(trajectory_costs([criterion], [trajectory], world)[0, 0])


def trajectory_costs(
    criteria: Sequence[Criterion],
    trajectories: Sequence[Trajectory],
    world: World,
    *,
    table: MotionTable | None = None,
    say: Callable[[str], None] | None = None,
) -> FloatArray:
    """Return the costs (n, k) of n whole trajectories of one model by k criteria.

    The motions of all trajectories are evaluated together, one batch for each motion law. A motion that several
    trajectories share is evaluated once, unless its cost depends on the time or, along curves, on the motions before
    and after it. A time-mean is the time integral divided by the duration. Criteria with ``aggregate="trajectory"``
    are evaluated for each trajectory by itself. A trajectory without motions costs 0, except in missed stops.

    Parameters
    ----------
    table : the distinct motions of the trajectories, if the caller has them already
    say : called from time to time with a sentence on the progress
    """
    values = np.full((len(trajectories), len(criteria)), np.nan)
    with_memory = [j for j, criterion in enumerate(criteria) if criterion.aggregate == "trajectory"]
    for i, trajectory in enumerate(trajectories if with_memory else ()):
        if say is not None and i % PROGRESS_EVERY == 0:
            named = ", ".join(criteria[j].name for j in with_memory)
            say(f"{named} of {i:,} of {len(trajectories):,} trajectories")
        history = History(world, trajectory)  # caches intermediate results that several criteria use
        for j in with_memory:
            running = running_values(criteria[j], history)
            values[i, j] = running[-1] if running.size else _without_motions(criteria[j], history)
    additive = [j for j in range(len(criteria)) if j not in with_memory]
    if len(trajectories) > 1 and additive:
        shared = table or MotionTable.of(trajectories)
        values[:, additive] = _shared_costs([criteria[j] for j in additive], shared, world, say)
    unknown = np.isnan(values)
    rows, columns = np.flatnonzero(unknown.any(axis=1)).tolist(), np.flatnonzero(unknown.any(axis=0)).tolist()
    for part in _parts([len(trajectories[i]) for i in rows]):
        if say is not None:
            say(f"costs of {part.start:,} of {len(rows):,} trajectories")
        own = [trajectories[i] for i in rows[part]]
        values[np.ix_(rows[part], columns)] = _own_costs([criteria[j] for j in columns], own, world)
    return values


def _without_motions(criterion: Criterion, history: History) -> float:
    """Return the cost of a trajectory without motions by a criterion of whole trajectories: 0, except missed stops."""
    return cast("StopsMissed", criterion).without_motions(history) if criterion.role == "stops_missed" else 0.0


def _shared_costs(
    criteria: Sequence[Criterion], table: MotionTable, world: World, say: Callable[[str], None] | None
) -> FloatArray:
    """Return the costs (n, k) of trajectories by sums, means and maxima over motions; evaluate each motion once.

    The cost is NaN for trajectories with curves and for criteria that depend on the time; callers compute these costs
    in another way.
    """
    of_motions, lengths = np.zeros((len(criteria), len(table))), np.zeros(len(table))  # (k, M), (M,) s
    done = 0
    for index, motions in table.batches(world):
        lengths[index] = motions.duration
        for j, criterion in enumerate(criteria):
            if say is not None:
                say(f"{criterion.name} of {done:,} of {len(table):,} motions")
            try:
                of_motions[j, index] = motion_costs(criterion, motions)
            except (CriterionError, UnsupportedCriterion):  # _own_costs evaluates it with times, or raises the error
                of_motions[j] = np.nan
        done += index.size
    of_motions[:, table.curved] = np.nan
    durations = np.bincount(table.owner, lengths[table.motions], minlength=len(table.counts))  # (n,) s, in time order
    values = []
    for costs, criterion in zip(of_motions, criteria, strict=True):
        total = table.maxima(costs) if criterion.aggregate == "max" else table.sums(costs)
        if criterion.aggregate == "time-mean":
            total = np.divide(total, durations, out=np.zeros(durations.size), where=durations > 0)
        values.append(total)
    return np.stack(values, axis=1)


def _own_costs(criteria: Sequence[Criterion], trajectories: Sequence[Trajectory], world: World) -> FloatArray:
    """Return the costs (n, k) of trajectories by criteria that are sums, means or maxima over motions.

    Each motion is evaluated at its time in the trajectory, and knows the motions before and after it.
    """
    values = np.zeros((len(trajectories), len(criteria)))
    durations = np.array([trajectory.duration for trajectory in trajectories])
    for owner, motions in batches(trajectories, world):
        for j, criterion in enumerate(criteria):
            if criterion.aggregate == "max":
                np.maximum.at(values[:, j], owner, motion_costs(criterion, motions))
            else:
                values[:, j] += np.bincount(owner, motion_costs(criterion, motions), minlength=len(trajectories))
    for j, criterion in enumerate(criteria):
        if criterion.aggregate == "time-mean":
            values[:, j] = np.divide(values[:, j], durations, out=np.zeros(len(trajectories)), where=durations > 0)
    return values


def _parts(counts: Sequence[int]) -> Iterator[slice]:
    """Yield slices that divide trajectories into blocks of about ``BLOCK`` motions.

    counts  number of motions of each trajectory
    """
    begin = motions = 0
    for i, number in enumerate(counts):
        motions += number
        if motions >= BLOCK or i == len(counts) - 1:
            yield slice(begin, i + 1)
            begin, motions = i + 1, 0


def running_costs(criterion: Criterion, trajectory: Trajectory, world: World) -> FloatArray:
    """Return the cost (M,), by a criterion of whole trajectories, up to the end of each motion of a trajectory."""
    return running_values(criterion, History(world, trajectory))


def running_values(criterion: Criterion, history: History) -> FloatArray:
    """Return the cost (M,) of a trajectory, given as a history, up to the end of each of its motions.

    The criterion must have ``aggregate="trajectory"``.
    """
    return _checked_costs(criterion, history, len(history), "trajectory") if len(history) else np.zeros(0)


def with_quanta(criteria: Sequence[C], quanta: Mapping[str, Any] | None) -> tuple[C, ...]:
    """Return copies of criteria with the quanta (smallest differences that count) that a user has set.

    quanta  by name of a criterion, or of the sum that searches minimise in place of a time-mean

    Raises CriterionError for an unknown name, a quantum that is not positive, and a quantum other than 1 for a count.

    >>> from hpop.criteria.comfort.motion import Length
    >>> with_quanta([Length()], {"length": 0.001})[0].quantum, Length().quantum
    (0.001, 1e-06)
    """
    if not quanta:
        return tuple(criteria)
    if not isinstance(quanta, Mapping):
        raise CriterionError(
            f"quanta must map names of costs to numbers, such as {{'length': 0.01}}, got {shown(quanta)}"
        )
    stand_ins = [criterion.integral for criterion in criteria if criterion.integral is not None]
    by_name: dict[str, Criterion] = {**{c.name: c for c in criteria}, **{c.name: c for c in stand_ins}}
    for name, quantum in quanta.items():
        if name not in by_name:
            raise CriterionError(
                f"quanta must name criteria of this problem, got {shown(name)}.{did_you_mean(name, by_name)} "
                f"They are {', '.join(by_name)}"
            )
        unit = by_name[name].unit
        real(f"the quantum of {name}", quantum, FINEST, MOST, f"a number, in {unit!r}", error=CriterionError)
        if by_name[name].quantum == 1.0 != quantum and not by_name[name].smooth:
            raise CriterionError(
                f"the quantum of {name} must be 1, because it is a count, got {shown(quantum)}; leave it out"
            )
    return tuple(_with_quantum(criterion, quanta) for criterion in criteria)


def stand_in_of(mean: Criterion) -> Criterion | None:
    """Return the sum that searches minimise in place of a time-mean, with its quantum as the user set it.

    None if the mean declares no such sum; planners then take its time integral.
    """
    if mean.integral is None or mean.stand_in_quantum is None:
        return mean.integral
    return _set(mean.integral, "quantum", mean.stand_in_quantum)


def quanta_statement(criteria: Sequence[Criterion], quanta: Mapping[str, float]) -> str:
    """Return a text on the quanta that the user has set, to be appended to a front's certificate; "" if none.

    >>> from hpop.criteria.comfort.motion import Length
    >>> quanta_statement(with_quanta([Length()], {"length": 0.001}), {"length": 0.001})
    '; quanta as set: length 0.001 m'
    """
    own = [f"{c.name} {c.quantum:g}{f' {c.unit}' if c.unit != '1' else ''}" for c in criteria if c.name in quanta]
    return f"; quanta as set: {', '.join(own)}" if own else ""


def _with_quantum(criterion: C, quanta: Mapping[str, float]) -> C:
    """Return a copy of one criterion with the user's quanta for it and, if it is a time-mean, for the sum minimised."""
    stand_in = criterion.integral
    if stand_in is not None and stand_in.name in quanta:
        criterion = _set(criterion, "stand_in_quantum", quanta[stand_in.name])
    return _set(criterion, "quantum", quanta[criterion.name]) if criterion.name in quanta else criterion


def _set(criterion: C, name: str, quantum: float) -> C:
    """Return a copy of a criterion with another quantum, as an instance attribute that hides the class attribute.

    name  the attribute: "quantum" or "stand_in_quantum"
    """
    changed = copy(criterion)
    try:
        object.__setattr__(changed, name, float(quantum))
    except AttributeError:
        raise CriterionError(
            f"to set the quantum of {criterion.name}, its class {type(criterion).__name__} must not have slots, but it "
            "has; declare it without slots"
        ) from None
    return changed
