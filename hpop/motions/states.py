"""States as named columns, their space, and the poses and twists of bodies.

Every wrap of a state happens here: a column that turns is an angle in which 2 pi is a whole turn, such as a heading or
a joint without end stops. A half turn is +pi, counter-clockwise, as in :func:`hpop.base.math.wrap`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column
from hpop.base.math import not_radians, wrap
from hpop.base.options import MOST, real, whole
from hpop.base.randomness import RNG
from hpop.base.text import article, shown
from hpop.errors import ModelError, QueryError, did_you_mean

Vector = tuple[Column, Column, Column]
Values = tuple[float | None, ...]
StateSpec = Sequence[float | None] | Mapping[str, float | None] | str
MOST_SAMPLED = 10_000_000
"""Largest number of states in one sample."""
KINDS = {"m": "a position in m", "rad": "an angle in rad"}


@checked_arguments
class States:
    """States of a system as named columns: ``states.x``, ``states.yaw``, each of shape (M,).

    >>> import numpy as np
    >>> s = States(x=np.zeros(2), y=np.ones(2), yaw=np.zeros(2))
    >>> s.size, s.names, float(s.take(1).y)
    (2, ('x', 'y', 'yaw'), 1.0)
    """

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


class Pose(Protocol):
    """Pose of a body: columns in m and rad, world frame (REP-103), yaw counter-clockwise, pitch up, roll to the right.

    ``ahead``, ``left`` and ``up`` are its axes, unit vectors.
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


class Twist(Protocol):
    """Velocity and rotation of a body: three columns each, world frame; 0.0 for a component that is always zero."""

    @property
    def velocity(self) -> Vector: ...
    @property
    def rotation(self) -> Vector: ...


class LazyStates(States):
    """States with columns that are computed when read; the names that were read are recorded."""

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
    """Return states with columns that ``pick`` selects when they are first read."""
    return LazyStates(states.names, states.size, lambda name: pick(getattr(states, name)), set())


@checked_arguments
@dataclass(frozen=True)
class StateSpace:
    """State space of a model: columns in order.

    names    k of them
    units    of each: "m", "rad", ...
    low      least value of each; for a column that turns, the begin of the interval of samples
    high     greatest value of each, or the end of that interval
    weights  m per unit, for distances: path of the robot in the time in which the column changes by one unit
    turning  names of the columns in which 2 pi is a whole turn; their values have no limits
    named    states with a name, which users may give in place of the values
    unnamed  reasons why names are not in ``named``, by the name; under "" the reason for all other names
    rest     values that some columns have while the others change: an arm is folded while its base drives;
             half of all samples have them

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
            raise ModelError(f"a state space has a name, unit, low, high and weight for each column, got {self!r}")
        if not self.turning <= self.angles:
            raise ModelError(f"only columns in rad turn, got {', '.join(sorted(self.turning))} of {self}")
        if not all(low <= high for low, high in zip(self.low, self.high, strict=True)):
            raise ModelError(f"low must not be above high in each column of {self}, got {self.low} and {self.high}")

    def __str__(self) -> str:
        return f"({', '.join(f'{name} {unit}' for name, unit in zip(self.names, self.units, strict=True))})"

    @property
    def angles(self) -> frozenset[str]:
        """Names of the columns in rad, which a goal may leave free."""
        return frozenset(name for name, unit in zip(self.names, self.units, strict=True) if unit == "rad")

    def bounded(self, **bounds: tuple[float, float]) -> StateSpace:
        """Return the space with (low, high) of some columns, for example from the world."""
        rows = (bounds.get(name, old) for name, *old in zip(self.names, self.low, self.high, strict=True))
        low, high = zip(*rows, strict=True)
        return replace(self, low=low, high=high)

    # One state, as it is given

    def state(self, values: StateSpec, *, free: Iterable[str] = (), what: str = "state") -> States:
        """Return one checked state from values, in order or by name.

        A value may be None, stored as NaN, if it is in ``free``.

        Raises QueryError, which calls the state ``what``.
        """
        given = self.by_name(values, what)
        checked = {
            name: np.nan if value is None and name in free else self.checked(name, value, what)
            for name, value in given.items()
        }
        return States(**{name: np.array([value], float) for name, value in checked.items()})

    def values(self, state: States) -> Values:
        """Return the values of one state in the order of the names, None where it is free."""
        row = (float(getattr(state, name)[0]) for name in self.names)
        return tuple(None if np.isnan(value) else value for value in row)

    def by_name(self, values: Any, what: str) -> dict[str, Any]:
        """Return the given value of each column, in order; QueryError for columns that the model does not have."""
        if isinstance(values, str):
            values = self.called(values, what)
        if isinstance(values, Mapping):
            if misfit := self.misfit(values):
                raise QueryError(f"the {what} is {self}, got {shown(values)}: {misfit}")
            return {name: values[name] for name in self.names}
        try:
            return dict(zip(self.names, values, strict=True))
        except (TypeError, ValueError):
            raise QueryError(f"the {what} is {self}, got {shown(values)}") from None

    def called(self, name: str, what: str) -> Values:
        """Return the state with a name; QueryError if there is none."""
        if name not in self.named:
            known = f"the name of one: {', '.join(self.named)}" if self.named else "a name, but this model names none"
            why = self.unnamed.get(name) or self.unnamed.get("")
            hint = f": {why}." if why else f".{did_you_mean(name, self.named)}"
            raise QueryError(f"the {what} {shown(name)} names no state{hint} It is {self}, or {known}")
        return self.named[name]

    def misfit(self, values: Mapping[Any, Any]) -> str:
        """Return which columns are missing or unknown among given values; "" if all fit."""
        strange = [name for name in values if name not in self.names]
        lacking = [name for name in self.names if name not in values]
        faults = [f"lacks {', '.join(lacking)}"] * bool(lacking)
        faults += [f"names {', '.join(map(shown, strange))}, which is no state of the model"] * bool(strange)
        hint = "".join(did_you_mean(name, lacking or self.names) for name in strange)
        return f"it {' and '.join(faults)}{'.' * bool(hint)}{hint}" if faults else ""

    def checked(self, name: str, value: Any, what: str, label: str = "") -> float:
        """Return a valid value of a column, else raise QueryError, which calls it ``label`` or a column of ``what``."""
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
        """Return states b (M,) with turning columns continuous from those of a: at most half a turn away."""
        columns = {name: getattr(b, name) for name in self.names}
        for name in self.turning:
            begin = getattr(a, name)
            columns[name] = begin + wrap(columns[name] - begin)
        return States(**columns)

    def turns(self, states: States) -> dict[str, Column]:
        """Return the angles (N - 1,), rad, by which each turning column turns from state to state, the shorter way."""
        return {name: wrap(np.diff(getattr(states, name))) for name in self.turning}

    def differences(self, a: States, b: States) -> dict[str, Column]:
        """Return the differences b - a (M,) by name, the shorter way round where a column turns."""
        onward = self.onward(a, b)
        return {name: getattr(onward, name) - getattr(a, name) for name in self.names}

    def apart(self, a: States, b: States) -> Column:
        """Return the distance (M,), m: a metric of the weighted differences of the columns."""
        differences = self.differences(a, b)
        return np.sqrt(sum((w * differences[name]) ** 2 for name, w in zip(self.names, self.weights, strict=True)))

    def sample(self, rng: RNG, n: int) -> States:
        """Draw states (n,), uniform between low and high; half of them have the values of ``rest``, if any."""
        n = whole("n", n, 0, MOST_SAMPLED, "a number of states")
        rng = np.random.default_rng(rng)
        drawn = dict(zip(self.names, rng.uniform(self.low, self.high, (n, len(self.names))).T, strict=True))
        if self.rest:
            rests = rng.random(n) < 0.5
            drawn |= {name: np.where(rests, value, drawn[name]) for name, value in self.rest.items()}
        return States(**drawn)
