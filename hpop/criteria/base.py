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
from collections.abc import Callable, Mapping
from typing import Any, Literal, Protocol, TypeVar, cast, get_args, runtime_checkable

import numpy as np

from hpop.arrays import Column, FloatArray
from hpop.errors import CriterionError
from hpop.motions import Motions, missing
from hpop.registry import criteria
from hpop.trajectory import Trajectory

Group = Literal["P", "C", "R", "O"]
Aggregate = Literal["sum", "time-mean", "max", "trajectory"]
DEFAULT_QUANTUM = 1e-6
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

    def cost(self, m: Motions) -> Column:
        """Cost (M,) of each motion: its share of the sum, its integral, its worst moment, or the running value."""


def criterion(
    name: str,
    *,
    group: Group,
    unit: str,
    aggregate: Aggregate,
    requires: tuple[str, ...] = (),
    smooth: bool = True,
    quantum: float = DEFAULT_QUANTUM,
) -> Callable[[T], T]:
    """Declare and register a criterion; see :class:`Criterion` for what the arguments mean.

    Raises CriterionError when the declaration is wrong or the name is taken.
    """

    def declare(cls: T) -> T:
        checks = {
            "name must be a non-empty word": bool(name) and not name.isspace(),
            f"group must be one of {get_args(Group)}, got {group!r}": group in get_args(Group),
            "unit must be given; use '1' for a count or a share": bool(unit),
            f"aggregate must be one of {get_args(Aggregate)}, got {aggregate!r}": aggregate
            in get_args(Aggregate),
            f"quantum must be a positive number, got {quantum!r}": 0 < quantum < np.inf,
            "the class must be a dataclass; put @dataclass(frozen=True) below @criterion": dataclasses.is_dataclass(
                cls
            ),
            "the class needs a method cost(self, m)": callable(getattr(cls, "cost", None)),
        }
        wrong = [text for text, holds in checks.items() if not holds]
        if wrong:
            raise CriterionError(f"criterion {name!r} ({cls.__qualname__}): {'; '.join(wrong)}")
        declared = dict(
            name=name,
            group=group,
            unit=unit,
            aggregate=aggregate,
            requires=requires,
            smooth=smooth,
            quantum=quantum,
        )
        taken = {field.name for field in dataclasses.fields(cls)} & set(declared)
        if taken:
            raise CriterionError(f"criterion {name!r}: parameters may not be called {sorted(taken)}")
        for key, value in declared.items():
            setattr(cls, key, value)
        criteria.add(name, cls)
        return cls

    return declare


def make_criterion(spec: str | Criterion | Mapping[str, Mapping[str, Any]]) -> Criterion:
    """A criterion from its name, from ``{name: {parameter: value}}``, or itself.

    Raises UnknownName for a name nobody registered and CriterionError for parameters it does not have.
    """
    if isinstance(spec, str):
        spec = {spec: {}}
    if not isinstance(spec, Mapping):
        if not isinstance(spec, type) and isinstance(spec, Criterion):
            return spec
        raise CriterionError(
            f"a criterion is a name or an instance such as Turns(), got {spec!r}; declare a class with @hpop.criterion"
        )
    if len(spec) != 1:
        raise CriterionError(f"a criterion is given as one name with its parameters, got {dict(spec)!r}")
    ((name, parameters),) = spec.items()
    cls = criteria[name]
    known = [field.name for field in dataclasses.fields(cls)]
    strange = sorted(set(parameters or {}) - set(known))
    if strange:
        raise CriterionError(
            f"criterion {name!r} has no parameter {', '.join(map(repr, strange))}; it has {', '.join(known) or 'none'}"
        )
    return cast(Criterion, cls(**(parameters or {})))


def describe_criterion(criterion: Criterion) -> dict[str, dict[str, Any]]:
    """The JSON-able form that :func:`make_criterion` reads back."""
    fields = dataclasses.fields(criterion)  # type: ignore[arg-type]
    return {criterion.name: {field.name: getattr(criterion, field.name) for field in fields}}


def motion_costs(criterion: Criterion, motions: Motions) -> FloatArray:
    """Costs (M,) of motions, checked: one finite number >= 0 a motion.

    Raises CriterionError that names the criterion, the kind of motion and the first wrong value.
    """
    lacking = missing(criterion.requires, motions.model, motions.world)
    if lacking:
        raise CriterionError(
            f"criterion {criterion.name!r} requires {', '.join(lacking)}, which neither the model nor the world has"
        )
    costs = np.asarray(criterion.cost(motions))
    if costs.shape != (len(motions),):
        raise CriterionError(
            f"criterion {criterion.name!r} must return one cost a motion, shape ({len(motions)},), "
            f"for {motions.kind!r} motions; it returned shape {costs.shape}"
        )
    if not (np.issubdtype(costs.dtype, np.number) or costs.dtype == bool):
        raise CriterionError(f"criterion {criterion.name!r} must return numbers, got dtype {costs.dtype}")
    costs = costs.astype(np.float64)
    wrong = ~(costs >= 0) | np.isinf(costs)
    if wrong.any():
        value = costs[np.argmax(wrong)]
        raise CriterionError(
            f"criterion {criterion.name!r} must cost a finite number >= 0, but {int(wrong.sum())} of {len(motions)} "
            f"{motions.kind!r} motions cost {value}; shift or clip it in cost()"
        )
    return costs


def trajectory_cost(criterion: Criterion, trajectory: Trajectory, world: Any) -> float:
    """The criterion's value on a whole trajectory; 0 where the start is the goal and nothing moves.

    A time-mean is its integral over the duration. With ``aggregate="trajectory"`` every stretch of motions under one law
    is a batch in time order and the last running value counts.
    """
    costs = np.zeros(len(trajectory))
    for index, motions in trajectory.batches(world):
        costs[index] = motion_costs(criterion, motions)
    if not costs.size:
        return 0.0
    if criterion.aggregate == "max":
        return float(costs.max())
    if criterion.aggregate == "trajectory":
        return float(costs[-1])
    total = float(costs.sum())
    return total / trajectory.duration if criterion.aggregate == "time-mean" else total
