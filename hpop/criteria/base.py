"""What a criterion is: a plain NumPy function of motions, and what it declares.

A criterion is a frozen dataclass (its fields are its parameters) with a method ``cost(m)`` that gives one number a
motion, minimised, >= 0::

    @hpop.criterion("rotation", group="C", unit="rad", aggregate="sum")
    @dataclass(frozen=True)
    class Rotation:
        def cost(self, m: Motions) -> Column:
            return m.camera.turned

The four groups are the paper's (Becerra et al. 2020, arXiv 2002.10696): P performance (the camera does its work),
C comfort of the immersed user, R robot, O others near the robot.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from shlex import quote
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar, cast, get_args, runtime_checkable

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column, FloatArray
from hpop.base.registry import completed, criteria, made
from hpop.base.text import shown
from hpop.errors import CriterionError, HpopError, UnsupportedCriterion, own_failure
from hpop.motions import MODEL_DEFAULTS, Model, Motions, lacking, laws_of
from hpop.runtime.limits import LimitPassed
from hpop.trajectories.batches import batches
from hpop.trajectories.history import History
from hpop.trajectories.motion_table import BLOCK, MotionTable
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.criteria.convex import ConvexCost, ConvexPath
    from hpop.motions import States
    from hpop.world import World

Group = Literal["P", "C", "R", "O"]
Aggregate = Literal["sum", "time-mean", "max", "trajectory"]
Role = Literal["duration", "length", "turns"]
DEFAULT_QUANTUM = 1e-6
SPOKEN = 100  # trajectories between two reports of how far an evaluation is
T = TypeVar("T", bound=type)


@runtime_checkable
class Criterion(Protocol):
    """What planners and fronts know of a criterion.

    name       as the registry has it
    group      P, C, R or O
    unit       of the cost, SI; "1" for a count or a share
    aggregate  how motions add up: sum; time-mean (sum over duration); max (worst moment); trajectory (with memory)
    requires   bodies or world contents it needs: "camera", "people", ...
    smooth     whether the cost has a gradient; a nonlinear program refuses the others by name
    quantum    resolution at which costs are compared, in the unit: exact searches add integers of it

    These may be left out, and have defaults:

    role         "duration", "length" or "turns", where planners know the cost as that; None
    world_frame  whether it knows directions or places by itself, apart from the world's content; False
    instead      names of criteria for models that lack what it requires; ()
    integral     of a time-mean: the criterion that adds up in its place; None for its own integral over time
    mean         of what stands in for a time-mean: that one; None
    stand_in_quantum  quantum of what adds up in its place, where one was set; None
    places       (x, y, z) m, that pictures mark; ()
    bound        method of states (M,) and others: a lower bound (M,) on the cost of any trajectory between them; None
    convex       method of a path: the cost of polylines as a convex expression, :mod:`hpop.criteria.convex`; None
    """

    @property
    def name(self) -> str: ...
    @property
    def group(self) -> Group: ...
    @property
    def unit(self) -> str: ...
    @property
    def aggregate(self) -> Aggregate: ...
    @property
    def requires(self) -> tuple[str, ...]: ...
    @property
    def smooth(self) -> bool: ...
    @property
    def quantum(self) -> float: ...
    def cost(self, m: Any) -> Column:
        """Cost (M,) of each motion of :class:`hpop.Motions`: its share of the sum, its integral, its worst moment.

        With memory (aggregate "trajectory"), the running value (M,) at the end of each motion of a
        :class:`hpop.trajectories.history.History`.
        """

    if TYPE_CHECKING:  # the defaults are set by `completed`

        @property
        def role(self) -> Role | None: ...
        @property
        def world_frame(self) -> bool: ...
        @property
        def instead(self) -> tuple[str, ...]: ...
        @property
        def integral(self) -> Criterion | None: ...
        @property
        def mean(self) -> Criterion | None: ...
        @property
        def stand_in_quantum(self) -> float | None: ...
        @property
        def places(self) -> tuple[tuple[float, float, float], ...]: ...
        @property
        def bound(self) -> Callable[[States, States], Column] | None: ...
        @property
        def convex(self) -> Callable[[ConvexPath], ConvexCost] | None: ...


CRITERION_DEFAULTS: dict[str, Any] = {
    "role": None,
    "world_frame": False,
    "instead": (),
    "integral": None,
    "mean": None,
    "stand_in_quantum": None,
    "places": (),
    "bound": None,
    "convex": None,
}
"""What a criterion has of the contract without saying so."""


CriterionSpec = str | Criterion | Mapping[str, Mapping[str, Any] | None]


@checked_arguments
def criterion(
    name: str,
    *,
    group: Group,
    unit: str,
    aggregate: Aggregate,
    requires: tuple[str, ...] = (),
    smooth: bool = True,
    quantum: float = DEFAULT_QUANTUM,
    world_frame: bool = False,
    role: Role | None = None,
    instead: tuple[str, ...] = (),
) -> Callable[[T], T]:
    """Declare and register a criterion; see :class:`Criterion` for what the arguments mean.

    ``world_frame`` says that it knows directions or places by itself, apart from the world's content (where the sun
    stands), so that turning the world with everything in it changes its cost. ``role`` says that it is what planners
    know as the duration, the length of the way or the number of turns, whatever its name. ``instead`` names criteria
    for models that lack what it requires.

    Raises CriterionError when the declaration is wrong or the name is taken.
    """

    def declare(cls: T) -> T:
        checks = {
            "name must be a non-empty word": bool(name) and not name.isspace(),
            f"group must be one of {get_args(Group)}, got {group!r}": group in get_args(Group),
            "unit must be given; use '1' for a count or a share": bool(unit),
            f"aggregate must be one of {get_args(Aggregate)}, got {aggregate!r}": aggregate in get_args(Aggregate),
            f"requires must be a tuple of names, such as ('camera',), got {requires!r}": isinstance(requires, tuple),
            f"role must be one of {get_args(Role)} or None, got {role!r}": role in (None, *get_args(Role)),
            f"quantum must be a positive number, got {quantum!r}": 0 < quantum < np.inf,
            "the class must be a dataclass; put @dataclass(frozen=True) below @criterion": dataclasses.is_dataclass(
                cls
            ),
            "the class needs a method cost(self, m)": callable(getattr(cls, "cost", None)),
        }
        wrong = [text for text, holds in checks.items() if not holds]
        if wrong:
            raise CriterionError(f"criterion {name!r} ({cls.__qualname__}): {'; '.join(wrong)}")
        declared = {
            "name": name,
            "group": group,
            "unit": unit,
            "aggregate": aggregate,
            "requires": requires,
            "smooth": smooth,
            "quantum": quantum,
            "world_frame": world_frame,
            "role": role,
            "instead": instead,
        }
        taken = {field.name for field in dataclasses.fields(cls)} & set(declared)
        if taken:
            raise CriterionError(f"criterion {name!r}: parameters may not be called {sorted(taken)}")
        for key, value in declared.items():
            setattr(cls, key, value)
        criteria.add(name, completed(cls, CRITERION_DEFAULTS))
        return checked_arguments(cls)

    return declare


@checked_arguments
def make_criterion(spec: CriterionSpec) -> Criterion:
    """A criterion from its name, from ``{name: {parameter: value}}``, or itself.

    Raises UnknownName for a name nobody registered and CriterionError for parameters it does not have.
    """
    if isinstance(spec, str | Mapping):
        return cast(Criterion, made(criteria, spec))
    if not isinstance(spec, type) and isinstance(spec, Criterion):
        return completed(spec, CRITERION_DEFAULTS)
    raise CriterionError(
        f"a criterion is a name or an instance such as Turns(), got {shown(spec)}; declare a class with @hpop.criterion"
    )


def place_of(role: Role, criteria: Sequence[Criterion]) -> int | None:
    """Place of the criterion that planners know by a role; None if none of them has it."""
    return next((j for j, criterion in enumerate(criteria) if criterion.role == role), None)


def describe_criterion(criterion: Criterion) -> dict[str, dict[str, Any]]:
    """The JSON-able form that :func:`make_criterion` reads back."""
    fields = dataclasses.fields(criterion)  # type: ignore[arg-type]
    return {criterion.name: {field.name: getattr(criterion, field.name) for field in fields if field.init}}


def check_usable(criterion: Criterion, model: Model, world: World) -> None:
    """Raise CriterionError where a criterion asks for what neither robot nor world has, or cannot be saved."""
    check_requirements(criterion, model, world)
    try:
        json.dumps(describe_criterion(criterion), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise CriterionError(
            f"criterion {criterion.name!r} cannot be described in a saved front: it must be a dataclass whose fields "
            f"are finite numbers, words, or lists of them ({error})"
        ) from None


def check_command(criterion: Criterion) -> str:
    """How the conformance checks of a criterion are run: by the file of its class, or its module in a package."""
    cls = _asked(criterion)
    file = getattr(sys.modules.get(cls.__module__), "__file__", None)
    source = cls.__module__ if "." in cls.__module__ or file is None else file
    return f"hpop check {quote(f'{source}:{cls.__qualname__}')}"


def _asked(criterion: Criterion) -> type:
    """The class of the criterion that was asked for: of a mean, where its time integral stands in for it."""
    cls, mean = type(criterion), criterion.mean
    return type(mean) if cls.__module__.startswith("hpop.") and mean is not None else cls


@checked_arguments
def motion_costs(criterion: Criterion, motions: Motions) -> FloatArray:
    """Costs (M,) of motions, checked: one finite number >= 0 a motion.

    Raises CriterionError that names the criterion, the kind of motion and the first wrong value; where somebody's
    ``cost`` itself raises an error, one that says where, from that error. Of no motions a criterion is not asked.
    """
    if not len(motions):
        check_requirements(criterion, motions.model, motions.world)
        return np.zeros(0)
    return _checked(criterion, motions, len(motions), motions.kind)


def check_requirements(criterion: Criterion, model: Model, world: World) -> None:
    """Raise CriterionError for a criterion that requires what a model and a world lack, with those to take instead."""
    absent = lacking(completed(criterion, CRITERION_DEFAULTS).requires, model, world)
    if not absent:
        return
    found = {name: cast(Criterion, criteria[name]) for name in criterion.instead if name in criteria}
    able = [name for name, one in found.items() if not lacking(one.requires, model, world)]
    raise CriterionError(
        f"criterion {criterion.name!r} requires {', '.join(absent)}, which neither the model nor the world has"
        + (f"; take {' or '.join(map(repr, able))}" if able else "")
    )


def _checked(criterion: Criterion, m: Motions | History, size: int, kind: str) -> FloatArray:
    laws_of(completed(m.model, MODEL_DEFAULTS))  # completes these as well
    check_requirements(criterion, m.model, m.world)
    try:
        costs = np.asarray(criterion.cost(m))
    except UnsupportedCriterion as error:
        raise UnsupportedCriterion(f"criterion {criterion.name!r} cannot be used here: {error}") from None
    except (HpopError, MemoryError, LimitPassed):
        raise
    except Exception as error:  # someone else's criterion: anything can come; one of hpop's own that fails is a bug
        if _asked(criterion).__module__.startswith("hpop."):
            raise
        failure = CriterionError(own_failure(f"criterion {criterion.name!r}", error))
        failure.add_note(f"`{check_command(criterion)}` tests it")
        raise failure from error
    if costs.shape != (size,):
        raise CriterionError(
            f"criterion {criterion.name!r} must return one cost a motion, shape ({size},), "
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
    """The criterion's value on one trajectory; see :func:`trajectory_costs`."""
    return float(trajectory_costs([criterion], [trajectory], world)[0, 0])


def trajectory_costs(
    criteria: Sequence[Criterion],
    trajectories: Sequence[Trajectory],
    world: World,
    *,
    table: MotionTable | None = None,
    say: Callable[[str], None] | None = None,
) -> FloatArray:
    """Values (n, k) of criteria on whole trajectories of one model; 0 where start is goal and nothing moves.

    The motions of all trajectories are evaluated together, grouped by law; one that several share is evaluated once,
    unless its cost depends on its time or, along curves, on its neighbours. A time-mean is the integral over the
    duration. With ``aggregate="trajectory"`` each trajectory is evaluated by itself, and the last running value counts.

    Parameters
    ----------
    table : the motions of the trajectories, where that is known
    say : called now and then with what is done, in words
    """
    values = np.full((len(trajectories), len(criteria)), np.nan)
    with_memory = [j for j, criterion in enumerate(criteria) if criterion.aggregate == "trajectory"]
    for i, trajectory in enumerate(trajectories if with_memory else ()):
        if say is not None and i % SPOKEN == 0:
            named = ", ".join(criteria[j].name for j in with_memory)
            say(f"{named} of {i:,} of {len(trajectories):,} trajectories")
        history = History(world, trajectory)  # what criteria derive from it, one derives for all
        for j in with_memory:
            running = running_values(criteria[j], history)
            values[i, j] = running[-1] if running.size else 0.0
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


def _shared_costs(
    criteria: Sequence[Criterion], table: MotionTable, world: World, say: Callable[[str], None] | None
) -> FloatArray:
    """Values (n, k) of criteria without memory, each distinct motion evaluated once.

    NaN of trajectories with curves, and for criteria that want to know when a motion begins.
    """
    each, lasts = np.zeros((len(criteria), len(table))), np.zeros(len(table))
    done = 0
    for index, motions in table.batches(world):
        lasts[index] = motions.duration
        for j, criterion in enumerate(criteria):
            if say is not None:
                say(f"{criterion.name} of {done:,} of {len(table):,} motions")
            try:
                each[j, index] = motion_costs(criterion, motions)
            except (CriterionError, UnsupportedCriterion):  # evaluated with its time, it says itself what is wrong
                each[j] = np.nan
        done += index.size
    each[:, table.curved] = np.nan
    durations = np.bincount(table.owner, lasts[table.motions], minlength=len(table.counts))  # (n,) s, in time order
    values = []
    for costs, criterion in zip(each, criteria, strict=True):
        total = table.maxima(costs) if criterion.aggregate == "max" else table.sums(costs)
        if criterion.aggregate == "time-mean":
            total = np.divide(total, durations, out=np.zeros(durations.size), where=durations > 0)
        values.append(total)
    return np.stack(values, axis=1)


def _own_costs(criteria: Sequence[Criterion], trajectories: Sequence[Trajectory], world: World) -> FloatArray:
    """Values (n, k) of criteria without memory, each motion evaluated at its time and with its neighbours."""
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
    """Runs of trajectories with so many motions each, of bounded size together."""
    begin = motions = 0
    for i, number in enumerate(counts):
        motions += number
        if motions >= BLOCK or i == len(counts) - 1:
            yield slice(begin, i + 1)
            begin, motions = i + 1, 0


def running_costs(criterion: Criterion, trajectory: Trajectory, world: World) -> FloatArray:
    """Running values (M,) of a criterion with memory at the end of each motion, checked like :func:`motion_costs`."""
    return running_values(criterion, History(world, trajectory))


def running_values(criterion: Criterion, history: History) -> FloatArray:
    """The same of a history."""
    return _checked(criterion, history, len(history), "trajectory") if len(history) else np.zeros(0)
