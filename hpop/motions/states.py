"""Robot states as named columns, state spaces, and protocols for poses and twists of bodies.

Angles of states are wrapped only here. A turning column is an angle for which 2 pi is a whole turn, such as a heading
or a joint without end stops. A half turn is +pi, counter-clockwise, as in :func:`hpop.base.math.wrap`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column, IntArray
from hpop.base.math import not_radians, wrap
from hpop.base.options import MOST, real, whole
from hpop.base.randomness import RNG
from hpop.base.text import article, shown
from hpop.errors import ModelError, QueryError, did_you_mean

Vector = tuple[Column, Column, Column]
Values = tuple[float | None, ...]
MOST_SAMPLED = 10_000_000
"""Largest number of states in one sample."""
ALIKE = 1e-9  # m or rad: tolerance for the ends of two motions that are the reverse of each other
DIGITS = 9  # decimals of the keys by which such pairs are found
KINDS = {"m": "a position in m", "rad": "an angle in rad"}


@checked_arguments
class States:
    """States of a system as named columns: ``states.x``, ``states.yaw``, each of shape (M,).

    >>> import numpy as np
    >>> s = States(x=np.zeros(2), y=np.ones(2), yaw=np.zeros(2))
    >>> s.size, s.names, float(s.take(1).y)
    (2, ('x', 'y', 'yaw'), 1.0)
    """

    made_by: ClassVar[str] = "model.space.state([x, y, ...])"
    """Call that makes states, for messages on arguments of a wrong type."""

    def __init__(self, **columns: Column) -> None:
        self.__dict__.update(columns)

    def __repr__(self) -> str:
        return f"<States: {self.size:,} of {', '.join(self.names)}>" if self.names else "<States: no columns>"

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Column: ...

    @property
    def names(self) -> tuple[str, ...]:
        """State names, in the model's order."""
        return tuple(self.__dict__)

    @property
    def size(self) -> int:
        """Number of states M."""
        return int(next(iter(self.__dict__.values())).shape[0])

    def take(self, index: Any) -> States:
        """Return the states at an index, a slice, or an index array."""
        return States(**{name: column[index] for name, column in self.__dict__.items()})

    def one(self, what: str = "state") -> dict[str, float | None]:
        """Return the values of a single state by name, with None for NaN (any value); QueryError for several states."""
        columns = {name: np.ravel(getattr(self, name)) for name in self.names}
        if sizes := {column.size for column in columns.values()} - {1}:
            raise QueryError(f"the {what} must be one state, got {max(sizes)} states; take one: states.take([0])")
        return {name: None if np.isnan(column[0]) else float(column[0]) for name, column in columns.items()}


StateSpec = Sequence[float | None] | Mapping[str, float | None] | str | States


class Pose(Protocol):
    """Pose of a body in the world frame (REP-103): position in m, angles in rad, each a column.

    Yaw is positive counter-clockwise, pitch upwards, roll to the right. ``ahead``, ``left`` and ``up`` are the axes of
    the body, as unit vectors; a component that is always the same may be a number.
    """

    @property
    def x(self) -> Column: ...
    @property
    def y(self) -> Column: ...
    @property
    def z(self) -> Column: ...
    @property
    def yaw(self) -> Column: ...
    @property
    def pitch(self) -> Column: ...
    @property
    def roll(self) -> Column: ...
    @property
    def ahead(self) -> Vector: ...
    @property
    def left(self) -> Vector: ...
    @property
    def up(self) -> Vector: ...


class LevelPose:
    """Base class of the poses of bodies that stay level; ``size`` is the number of states."""

    size: Any  # int
    yaw: Column

    @property
    def pitch(self) -> Column:
        return np.zeros(self.size)

    @property
    def roll(self) -> Column:
        return np.zeros(self.size)

    @property
    def ahead(self) -> Vector:
        return np.cos(self.yaw), np.sin(self.yaw), 0.0

    @property
    def left(self) -> Vector:
        return -np.sin(self.yaw), np.cos(self.yaw), 0.0

    @property
    def up(self) -> Vector:
        return 0.0, 0.0, 1.0


class Twist(Protocol):
    """Velocity, m/s, and angular velocity (``rotation``), rad/s, of a body in the world frame.

    Each has three columns; a component that is always zero is the number 0.0.
    """

    @property
    def velocity(self) -> Vector: ...
    @property
    def rotation(self) -> Vector: ...


class LazyStates(States):
    """States whose columns are computed when they are first read; the names of these columns are recorded."""

    def __init__(self, names: tuple[str, ...], size: int, column: Callable[[str], Column], read: set[str]) -> None:
        self.__dict__.update(_names=names, _size=size, _column=column, _read=read)

    def __getattr__(self, name: str) -> Column:
        if name not in self._names:
            raise AttributeError(f"no state {name!r}; this model has {', '.join(self._names)}")
        self._read.add(name)
        value = self.__dict__[name] = self._column(name)
        return value

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._names)

    @property
    def size(self) -> int:
        return int(self._size)

    def take(self, index: Any) -> States:
        return States(**{name: getattr(self, name)[index] for name in self._names})


def picked_states(states: States, pick: Callable[[Column], Column]) -> States:
    """Return states in which ``pick`` is applied to each column when the column is first read."""
    return LazyStates(states.names, states.size, lambda name: pick(getattr(states, name)), set())


def reverse_indices(start: States, end: States) -> IntArray:
    """Return an index (M,) that is equal for two motions if one is the reverse of the other.

    The index is that of the first of the two motions. A motion without a reverse gets its own index.
    """
    own = np.arange(start.size)
    before, after = (np.stack([getattr(states, name) for name in start.names]) for states in (start, end))
    weights = np.sqrt(np.arange(2.0, 2.0 + len(start.names)))  # two states hardly ever have equal weighted sums
    sums = np.sort(np.round([weights @ before, weights @ after], DIGITS), axis=0)
    _, first, which = np.unique(sums[0] + 1j * sums[1], return_index=True, return_inverse=True)
    twin = first[which]
    back = (np.abs(before - after[:, twin]) <= ALIKE) & (np.abs(after - before[:, twin]) <= ALIKE)
    return np.where(back.all(axis=0), twin, own)


@checked_arguments
@dataclass(frozen=True)
class StateSpace:
    """State space of a model: its state columns in order, with units, bounds and weights.

    names    names of the k columns
    units    unit of each column: "m", "rad", ...
    low      smallest value of each column; for a turning column, lower end of the interval from which samples are drawn
    high     largest value of each column, or upper end of that interval
    weights  m per unit, used in distances: how far the robot drives in the time in which the column changes by one unit
    turning  names of the columns for which 2 pi is a whole turn; their values have no limits
    named    states that users may give by a name instead of by values
    unnamed  for names that users may expect in ``named``: the reason why each is missing; "" is the key of the reason
             for all others
    rest     resting values of some columns, such as those of an arm that is folded while its base drives; half of all
             samples have them

    >>> plane = StateSpace(("x", "y", "yaw"), ("m", "m", "rad"), (0, 0, -np.pi), (9, 9, np.pi), (1, 1, 0.5), {"yaw"})
    >>> print(plane)
    (x m, y m, yaw rad)
    >>> plane.values(plane.state([1, 2, None], free=plane.angles))
    (1.0, 2.0, None)
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    weights: tuple[float, ...]
    turning: frozenset[str] = frozenset()
    named: Mapping[str, Values] = dataclasses.field(default_factory=dict, hash=False)
    rest: Mapping[str, float] = dataclasses.field(default_factory=dict, hash=False)
    unnamed: Mapping[str, str] = dataclasses.field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        for field in ("names", "units", "low", "high", "weights"):
            object.__setattr__(self, field, tuple(getattr(self, field)))
        object.__setattr__(self, "turning", frozenset(self.turning))
        sizes = {len(getattr(self, field)) for field in ("names", "units", "low", "high", "weights")}
        if sizes != {len(set(self.names))}:
            raise ModelError(
                "a state space needs different names, and a unit, low, high and weight for each of them, as tuples of "
                f"equal length, got {self!r}"
            )
        if not self.turning <= self.angles:
            raise ModelError(
                f"turning must name columns in rad only, got {', '.join(sorted(self.turning))} for the states {self}"
            )
        if not all(low <= high for low, high in zip(self.low, self.high, strict=True)):
            raise ModelError(
                f"low must not be above high for any of the states {self}, got low={self.low} and high={self.high}"
            )

    def __str__(self) -> str:
        return f"({', '.join(f'{name} {unit}' for name, unit in zip(self.names, self.units, strict=True))})"

    @property
    def angles(self) -> frozenset[str]:
        """Names of the columns in rad; a goal may leave these open (None)."""
        return frozenset(name for name, unit in zip(self.names, self.units, strict=True) if unit == "rad")

    def bounded(self, **bounds: tuple[float, float]) -> StateSpace:
        """Return the space with other bounds (low, high) for some columns, such as the extent of a world."""
        rows = (bounds.get(name, old) for name, *old in zip(self.names, self.low, self.high, strict=True))
        low, high = zip(*rows, strict=True)
        return replace(self, low=low, high=high)

    # One state, given by a user

    def state(self, values: StateSpec, *, free: Iterable[str] = (), what: str = "state") -> States:
        """Check one state and return it as states (1,).

        values  one value for each column, in order or by column name; the name of a state in ``named``; or States of
                one state, such as ``trajectory.at(12.5)``
        free    names of columns that may be None (any value), which is stored as NaN
        what    how the message of a QueryError calls the state: "start", "goal"
        """
        given = self.by_name(values, what)
        checked = {
            name: np.nan if value is None and name in free else self.checked(name, value, what)
            for name, value in given.items()
        }
        return States(**{name: np.array([value], float) for name, value in checked.items()})

    def values(self, state: States) -> Values:
        """Return the values of one state (1,) in the order of the columns, with None for NaN (any value)."""
        row = (float(getattr(state, name)[0]) for name in self.names)
        return tuple(None if np.isnan(value) else value for value in row)

    def by_name(self, values: Any, what: str) -> dict[str, Any]:
        """Return a user's values as a dict by column, in order, unchecked.

        Raises QueryError, which calls the state ``what``, if a column is unknown, or missing and not :meth:`implied`.
        """
        if isinstance(values, str):
            values = self.called(values, what)
        elif isinstance(values, States):
            values = {
                name: wrap(value) if name in self.turning and abs(value or 0) > np.pi else value
                for name, value in values.one(what).items()
            }
        values = self.completed(values, what)
        advice = "; write None for an angle that is free" if self.angles and what.startswith("goal") else ""
        if isinstance(values, Mapping):
            if misfit := self.misfit(values):
                raise QueryError(f"the {what} must be given as {self}, got {shown(values)}: {misfit}{advice}")
            return {name: values[name] for name in self.names}
        try:
            return dict(zip(self.names, values, strict=True))
        except (TypeError, ValueError):
            raise QueryError(f"the {what} must be given as {self}, got {shown(values)}{advice}") from None

    def implied(self, what: str) -> Mapping[str, float]:
        """Return values, by name, of the last columns, if users may leave these out of a state; here none."""
        return {}

    def completed(self, values: Any, what: str) -> Any:
        """Return a user's values, by name or in order, with those added that are :meth:`implied` and were left out."""
        implied = self.implied(what)
        if implied and isinstance(values, Mapping):
            return {**implied, **values}
        if implied and isinstance(values, list | tuple | np.ndarray) and len(values) == len(self.names) - len(implied):
            return [*values, *implied.values()]
        return values

    def called(self, name: str, what: str) -> Values:
        """Return the values of a named state, such as "home"; QueryError if the model has none of this name."""
        if name not in self.named:
            known = f", or by a name: {', '.join(self.named)}" if self.named else "; this model has no named states"
            why = self.unnamed.get(name) or self.unnamed.get("")
            hint = f": {why}." if why else f".{did_you_mean(name, self.named)}"
            raise QueryError(f"the {what} is {shown(name)}, but no state has this name{hint} Give it as {self}{known}")
        return self.named[name]

    def misfit(self, values: Mapping[Any, Any]) -> str:
        """Return a text on the columns that are missing or unknown in a dict of values; "" if there are none."""
        strange = [name for name in values if name not in self.names]
        lacking = [name for name in self.names if name not in values]
        faults = [f"lacks {', '.join(lacking)}"] * bool(lacking)
        faults += [f"names {', '.join(map(shown, strange))}, which is no state of the model"] * bool(strange)
        hint = "".join(did_you_mean(name, lacking or self.names) for name in strange)
        return f"it {' and '.join(faults)}{'.' * bool(hint)}{hint}" if faults else ""

    def checked(self, name: str, value: Any, what: str, label: str = "") -> float:
        """Check a value of the column ``name`` and return it as a float.

        Raises QueryError. The message calls the value ``label``, or for "" the column of ``what``: "yaw of the goal".
        """
        if name not in self.names:
            raise QueryError(f"name must be one of {', '.join(self.names)}, got {shown(name)}")
        column = self.names.index(name)
        unit, low, high = self.units[column], self.low[column], self.high[column]
        if unit != "rad":
            label = label or f"{name} of the {what}"
            return float(real(label, value, low, high, KINDS.get(unit, f"a number in {unit}"), error=QueryError))
        if value is None:
            raise QueryError(f"the {what} needs {article(name)} in rad; only the goal's may be free (None)")
        label = label or f"the {name} of the {what}"
        angle = real(label, value, -MOST, MOST, KINDS[unit], error=QueryError)
        if advice := not_radians(angle):
            raise QueryError(f"{label} {advice}")
        if name not in self.turning:
            real(label, angle, low, high, KINDS[unit], error=QueryError)
        return float(angle)

    # Many states

    def onward(self, a: States, b: States) -> States:
        """Return states b (M,) with whole turns added to their turning columns: at most half a turn from states a."""
        columns = {name: getattr(b, name) for name in self.names}
        for name in self.turning:
            begin = getattr(a, name)
            columns[name] = begin + wrap(columns[name] - begin)
        return States(**columns)

    def turns(self, states: States) -> dict[str, Column]:
        """Return, by turning column, the angles (N - 1,), rad, between consecutive states, the shorter way round."""
        return {name: wrap(np.diff(getattr(states, name))) for name in self.turning}

    def differences(self, a: States, b: States) -> dict[str, Column]:
        """Return the differences b - a (M,) by name, the shorter way round where a column turns."""
        onward = self.onward(a, b)
        return {name: getattr(onward, name) - getattr(a, name) for name in self.names}

    def apart(self, a: States, b: States) -> Column:
        """Return the distances (M,), m, between states a and b: the norm of the weighted differences of the columns."""
        differences = self.differences(a, b)
        return np.sqrt(sum((w * differences[name]) ** 2 for name, w in zip(self.names, self.weights, strict=True)))

    def sample(self, rng: RNG, n: int) -> States:
        """Draw n random states, uniform between low and high; half of them have the values of ``rest``, if any."""
        n = whole("n", n, 0, MOST_SAMPLED, "a number of states")
        rng = np.random.default_rng(rng)
        drawn = dict(zip(self.names, rng.uniform(self.low, self.high, (n, len(self.names))).T, strict=True))
        if self.rest:
            rests = rng.random(n) < 0.5
            drawn |= {name: np.where(rests, value, drawn[name]) for name, value in self.rest.items()}
        return States(**drawn)
