"""The space of a model's states: its columns, which of them come round, how far apart states are, and how one is given.

Every wrap of a state happens here: a column that turns is an angle in which 2 pi is a whole turn, such as a heading or
a joint without end stops. A half turn is +pi, counter-clockwise, as in :func:`hpop.base.math.wrap`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column
from hpop.base.math import not_radians, wrap
from hpop.base.options import MOST, real, whole
from hpop.base.randomness import RNG
from hpop.base.text import article, shown
from hpop.errors import ModelError, QueryError, did_you_mean
from hpop.motions.states import States

Values = tuple[float | None, ...]
StateSpec = Sequence[float | None] | Mapping[str, float | None] | str

MOST_SAMPLED = 10_000_000
"""States that are drawn at once."""
KINDS = {"m": "a position in m", "rad": "an angle in rad"}


@checked_arguments
@dataclass(frozen=True)
class StateSpace:
    """The states of a model: columns in order.

    names    k of them
    units    of each: "m", "rad", ...
    low      least value of each; where the column turns, from where to where a sample is drawn
    high     greatest value of each
    weights  m a unit: how far a robot moves in the time in which the column changes by one; of distances
    turning  names of the columns in which 2 pi is a whole turn; their values have no limits
    named    states that have a name, which may be given in their place
    unnamed  why a name is none of theirs, by the name, where that is known; under "" why no other is
    rest     values of some columns while the others change, if these have such: an arm is folded while its base drives;
             half of what is drawn has them

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
        """The same within (low, high) of some columns: a model's space cannot know how large the world is."""
        rows = (bounds.get(name, old) for name, *old in zip(self.names, self.low, self.high, strict=True))
        low, high = zip(*rows, strict=True)
        return replace(self, low=low, high=high)

    # One state, as it is given

    def state(self, values: StateSpec, *, free: Iterable[str] = (), what: str = "state") -> States:
        """One state, checked: values in the order of the names, or by name; None, which becomes NaN, only where free.

        Raises QueryError, which calls the state ``what``.
        """
        given = self.by_name(values, what)
        checked = {
            name: np.nan if value is None and name in free else self.checked(name, value, what)
            for name, value in given.items()
        }
        return States(**{name: np.array([value], float) for name, value in checked.items()})

    def values(self, state: States) -> Values:
        """The values of one state in the order of the names, None where it is free."""
        row = (float(getattr(state, name)[0]) for name in self.names)
        return tuple(None if np.isnan(value) else value for value in row)

    def by_name(self, values: Any, what: str) -> dict[str, Any]:
        """What is given for each column, in order; QueryError for other columns than the model's."""
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
        """The state of a name; QueryError where there is none."""
        if name not in self.named:
            known = f"the name of one: {', '.join(self.named)}" if self.named else "a name, but this model names none"
            why = self.unnamed.get(name) or self.unnamed.get("")
            hint = f": {why}." if why else f".{did_you_mean(name, self.named)}"
            raise QueryError(f"the {what} {shown(name)} names no state{hint} It is {self}, or {known}")
        return self.named[name]

    def misfit(self, values: Mapping[Any, Any]) -> str:
        """What is wrong with the names of the columns for which values are given, in words; nothing if they are all."""
        strange = [name for name in values if name not in self.names]
        lacking = [name for name in self.names if name not in values]
        faults = [f"lacks {', '.join(lacking)}"] * bool(lacking)
        faults += [f"names {', '.join(map(shown, strange))}, which is no state of the model"] * bool(strange)
        hint = "".join(did_you_mean(name, lacking or self.names) for name in strange)
        return f"it {' and '.join(faults)}{'.' * bool(hint)}{hint}" if faults else ""

    def checked(self, name: str, value: Any, what: str, label: str = "") -> float:
        """The value of one column of ``what``, or a QueryError, which calls it ``label``."""
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
        """States b (M,), their turning columns continuous from those of a: at most half a turn away."""
        columns = {name: getattr(b, name) for name in self.names}
        for name in self.turning:
            begin = getattr(a, name)
            columns[name] = begin + wrap(columns[name] - begin)
        return States(**columns)

    def turns(self, states: States) -> dict[str, Column]:
        """By how much (N - 1,), rad, each turning column turns from each of the states to the next, the shorter way."""
        return {name: wrap(np.diff(getattr(states, name))) for name in self.turning}

    def differences(self, a: States, b: States) -> dict[str, Column]:
        """What is to be added to a (M,) for b, by name, the shorter way round where a column turns."""
        onward = self.onward(a, b)
        return {name: getattr(onward, name) - getattr(a, name) for name in self.names}

    def apart(self, a: States, b: States) -> Column:
        """Distance (M,), m: a metric, the columns' differences weighted."""
        differences = self.differences(a, b)
        return np.sqrt(sum((w * differences[name]) ** 2 for name, w in zip(self.names, self.weights, strict=True)))

    def sample(self, rng: RNG, n: int) -> States:
        """States (n,), uniform between low and high; of a space with a rest half of them, by chance, at rest."""
        n = whole("n", n, 0, MOST_SAMPLED, "a number of states")
        rng = np.random.default_rng(rng)
        drawn = dict(zip(self.names, rng.uniform(self.low, self.high, (n, len(self.names))).T, strict=True))
        if self.rest:
            rests = rng.random(n) < 0.5
            drawn |= {name: np.where(rests, value, drawn[name]) for name, value in self.rest.items()}
        return States(**drawn)
