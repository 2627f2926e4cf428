"""Declaration of criteria: costs of motions, written as plain NumPy functions, with a unit, a group and an aggregate.

A criterion is a frozen dataclass whose fields are its parameters. Its method ``cost(m)`` returns one number >= 0 for
each motion of a batch, to be minimised::

    @hpop.criterion("rotation", group="C", unit="rad", aggregate="sum")
    @dataclass(frozen=True)
    class Rotation:
        def cost(self, m: Motions) -> Column:
            return m.camera.turned

The four groups are the paper's (Becerra et al. 2020, arXiv 2002.10696): P performance (the camera does its work), C
comfort of the immersed user, R robot, O others near the robot.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from shlex import quote
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar, cast, get_args, runtime_checkable

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column
from hpop.base.registry import GROUPS, criteria, plugin_from_spec, with_optional_members
from hpop.base.text import shown
from hpop.errors import CriterionError, did_you_mean
from hpop.motions import Model, lacking
from hpop.world import World

if TYPE_CHECKING:
    from hpop.criteria.comfort.sickness import Weighting
    from hpop.criteria.convex import ConvexCost, ConvexPath
    from hpop.motions import States
    from hpop.world import World

Group = Literal["P", "C", "R", "O"]
Aggregate = Literal["sum", "time-mean", "max", "trajectory"]
Role = Literal["duration", "length", "turns", "stops_missed"]
DEFAULT_QUANTUM = 1e-6
T = TypeVar("T", bound=type)


@runtime_checkable
class Criterion(Protocol):
    """Cost of motions that planners minimise, with all that planners and fronts need to know about it.

    name       name in the registry
    group      P (performance), C (comfort), R (robot) or O (others near the robot)
    unit       unit of the cost, SI; "1" for a count or a share
    aggregate  how a trajectory's cost follows from those of its motions: "sum"; "time-mean" (sum divided by duration);
               "max" (worst moment); "trajectory" (only defined for the trajectory as a whole)
    requires   bodies of the robot or contents of the world that it needs: "camera", "people", ...
    smooth     True if the cost has a gradient; nonlinear programs refuse criteria without one
    quantum    smallest difference, in the unit, that counts: exact searches round costs of motions to multiples of it

    A class may leave out these members; each entry ends with the default:

    role         "duration", "length", "turns" or "stops_missed" if planners may use the cost as this quantity; None
    world_frame  True if the cost contains a fixed direction or position, so that turning the world changes it; False
    instead      names of criteria to suggest for models that lack a requirement; ()
    integral     for a time-mean: the sum that searches minimise in its place (its stand-in); None for the time integral
                 of ``cost``
    mean         for a stand-in: the time-mean that it replaces; None
    stand_in_quantum  for a time-mean: the quantum that the user has set for its stand-in; None
    places       positions (x, y, z), m, that pictures mark; ()
    quantity     what the cost measures, such as "shortfall", if its name reads like the opposite; tables and pictures
                 print it before the unit; ""
    ball_radius  m, radius of a ball round the camera; pictures shade the map by its obstructed fraction; None
    measured_field  name of a measured field of the world, by which pictures shade the map; "" for the only one; None
    dose         for the root of the integral of a body's squared weighted acceleration: the body and the frequency
                 weighting, whose filter programs may have as states; None
    bound        method: takes two states (M,), returns a lower bound (M,) on the cost of any trajectory between them;
                 None
    convex       method: takes a polyline, returns its cost as a convex expression (:mod:`hpop.criteria.convex`); None
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
        """Return the cost (M,) of each motion of a batch ``m`` (:class:`hpop.Motions`).

        That is its contribution to the sum or time integral, or its worst moment. For the aggregate "trajectory", ``m``
        is a :class:`hpop.trajectories.history.History` (one trajectory). Then return the cost (M,) of the trajectory up
        to the end of each of its motions.
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
        def quantity(self) -> str: ...
        @property
        def places(self) -> tuple[tuple[float, float, float], ...]: ...
        @property
        def ball_radius(self) -> float | None: ...
        @property
        def measured_field(self) -> str | None: ...
        @property
        def dose(self) -> tuple[str, Weighting] | None: ...
        @property
        def bound(self) -> Callable[[States, States], Column] | None: ...
        @property
        def convex(self) -> Callable[[ConvexPath], ConvexCost] | None: ...


ROBOT_NEEDS = (
    "base",
    "camera",
    "tool",
    "joints",
    "heading",
    "wheels",
    "plane",
    "turn-move",
    "rigid",
    "time",
    "seat",
    "work_tool",
)
WORLD_NEEDS = (
    "obstacles",
    "keep_out",
    "people",
    "moving people",
    "groups",
    "landmarks",
    "fields",
    "speed zones",
    "one-way zones",
)
"""What the robots of hpop and worlds provide, for criteria that require it."""
CRITERION_DEFAULTS: dict[str, Any] = {
    "role": None,
    "world_frame": False,
    "instead": (),
    "integral": None,
    "mean": None,
    "stand_in_quantum": None,
    "places": (),
    "ball_radius": None,
    "measured_field": None,
    "quantity": "",
    "dose": None,
    "bound": None,
    "convex": None,
}
"""Defaults of a criterion's optional members."""


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
    """Declare and register a criterion: decorator of its class. :class:`Criterion` explains the arguments.

    ``world_frame`` says that the cost depends on a fixed direction or position, such as that of the sun, so that it
    changes if the world is turned together with everything in it. ``role`` says that planners may use the cost as the
    duration, the length of the path or the number of turns, whatever the criterion's name is. ``instead`` names
    criteria to suggest for models that lack a requirement.

    Raises CriterionError if the declaration is wrong or the name is taken.
    """
    groups = ", ".join(f"{letter!r} ({words})" for letter, words in GROUPS.items())

    def declare(cls: T) -> T:
        checks = {
            "name must be a non-empty word": bool(name) and not name.isspace(),
            f"group must be one of {groups}, got {group!r}": group in GROUPS,
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
            raise CriterionError(f"criterion {name!r} ({cls.__qualname__}) is declared wrongly: {'; '.join(wrong)}")
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
            raise CriterionError(
                f"criterion {name!r}: parameters must not be called {', '.join(sorted(taken))}, because the decorator "
                "sets these attributes; rename them"
            )
        for key, value in declared.items():
            setattr(cls, key, value)
        criteria.add(name, with_optional_members(cls, CRITERION_DEFAULTS))
        return checked_arguments(cls)

    return declare


@checked_arguments
def make_criterion(spec: CriterionSpec) -> Criterion:
    """Return a criterion, given its name, ``{name: {parameter: value}}`` or a criterion object.

    Raises UnknownName for a name that is not registered, and CriterionError for unknown parameters or other values.
    """
    if isinstance(spec, str | Mapping):
        return cast(Criterion, plugin_from_spec(criteria, spec))
    if not isinstance(spec, type) and isinstance(spec, Criterion):
        return with_optional_members(spec, CRITERION_DEFAULTS)
    raise CriterionError(
        f"a criterion must be a name or an instance such as Turns(), got {shown(spec)}; declare a class of your own "
        "with @hpop.criterion"
    )


def make_criteria(specs: Sequence[CriterionSpec]) -> tuple[Criterion, ...]:
    """Return the criteria of a list, each as by :func:`make_criterion`; CriterionError if one is listed twice."""
    if isinstance(specs, str | Mapping) or not isinstance(specs, Sequence) or not specs:
        raise CriterionError(f"criteria must be a list such as ['turns', 'length'], got {shown(specs)}")
    made = tuple(make_criterion(spec) for spec in specs)
    if repeated := sorted({c.name for c in made if sum(c.name == other.name for other in made) > 1}):
        raise CriterionError(f"each criterion must be listed once, got {', '.join(repeated)} more than once")
    return made


def quantity_of(name: str, groups: Iterable[str]) -> str:
    """Return what a column of a front measures if its name does not say it, such as "shortfall"; "" otherwise.

    name    of the column
    groups  groups of the front's costs, or of one of them. Without any group the costs are of no criterion, even if one
            has this name; "" is returned then
    """
    if not any(groups) or name not in criteria:
        return ""
    declared: Any = with_optional_members(criteria[name], CRITERION_DEFAULTS)
    return str(declared.quantity)


def index_of_role(role: Role, criteria: Sequence[Criterion]) -> int | None:
    """Return the index of the criterion with a role, such as "duration"; None if no criterion has it."""
    return next((j for j, criterion in enumerate(criteria) if criterion.role == role), None)


def describe_criterion(criterion: Criterion) -> dict[str, dict[str, Any]]:
    """Return name and parameters of a criterion for JSON; :func:`make_criterion` makes the criterion from them."""
    fields = dataclasses.fields(criterion)  # type: ignore[arg-type]
    return {criterion.name: {field.name: getattr(criterion, field.name) for field in fields if field.init}}


def check_usable(criterion: Criterion, model: Model, world: World) -> None:
    """Raise CriterionError if robot and world lack something that a criterion requires, or if it cannot be saved."""
    check_requirements(criterion, model, world)
    try:
        json.dumps(describe_criterion(criterion), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise CriterionError(
            f"criterion {criterion.name!r} must be a dataclass whose fields are finite numbers, strings, or lists of "
            f"them, so that it can be saved with a front; change its fields ({error})"
        ) from None


def check_command(criterion: Criterion) -> str:
    """Return the shell command by which a user tests a criterion: ``hpop check FILE:CLASS``."""
    cls = class_of(criterion)
    file = getattr(sys.modules.get(cls.__module__), "__file__", None)
    source = cls.__module__ if "." in cls.__module__ or file is None else file
    return f"hpop check {quote(f'{source}:{cls.__qualname__}')}"


def class_of(criterion: Criterion) -> type:
    """Return the class of a criterion; for a time integral that hpop made from a time-mean, the mean's class."""
    cls, mean = type(criterion), criterion.mean
    return type(mean) if cls.__module__.startswith("hpop.") and mean is not None else cls


def check_requirements(criterion: Criterion, model: Model, world: World) -> None:
    """Raise CriterionError if model and world lack something that a criterion requires.

    The error suggests other criteria; for a requirement that hpop does not know, it suggests known ones.
    """
    absent = lacking(with_optional_members(criterion, CRITERION_DEFAULTS).requires, model, world)
    if not absent:
        return
    robots, worlds = {*ROBOT_NEEDS, *model.provides}, {*WORLD_NEEDS, *world.contents}
    if unknown := [name for name in absent if name not in robots | worlds]:
        raise CriterionError(
            f"criterion {criterion.name!r} requires {', '.join(map(repr, unknown))}, which no robot of hpop and no "
            f"world provides.{''.join(did_you_mean(name, robots | worlds) for name in unknown)} Robots provide some of "
            f"{', '.join(sorted(robots))}; worlds some of {', '.join(sorted(worlds))}"
        )
    substitutes = {name: cast(Criterion, criteria[name]) for name in criterion.instead if name in criteria}
    usable = [name for name, substitute in substitutes.items() if not lacking(substitute.requires, model, world)]
    remedy = f"take {' or '.join(map(repr, usable))}" if usable else "leave it out"
    if absent == ["seat"]:
        remedy = "give the robot a seat, such as seat: [0.1, 0, 0.6] (m ahead, left, up), or leave the criterion out"
    raise CriterionError(
        f"criterion {criterion.name!r} requires {', '.join(absent)}, which neither the model nor the world has; "
        + remedy
    )


def check_stand_ins(criteria: Sequence[Criterion]) -> None:
    """Raise CriterionError if a time-mean and its integral, which searches minimise, have different parameters."""
    for mean in criteria:
        integral = mean.integral or mean
        for other in criteria:
            if other.name == integral.name and other != integral:
                raise CriterionError(
                    f"searches minimise {integral!r} in place of {mean.name!r}, but {other!r} is also listed; give "
                    "both equal parameters"
                )
