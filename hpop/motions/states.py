"""States as named columns, and the pose that a model makes of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column


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
        """The states at an index, a slice, or an index array."""
        return States(**{name: column[index] for name, column in self.__dict__.items()})


Vector = tuple[Column, Column, Column]


class Pose(Protocol):
    """Where a body is: columns in m and rad, world frame (REP-103), yaw counter-clockwise, pitch up, roll to the right.

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
    """How fast a body moves and turns: three columns each, world frame; the number 0.0 for what is always zero."""

    @property
    def velocity(self) -> Vector: ...
    @property
    def rotation(self) -> Vector: ...


class LazyStates(States):
    """States that are computed when read, and remember which were."""

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
    """States whose columns are picked only when they are read."""
    return LazyStates(states.names, states.size, lambda name: pick(getattr(states, name)), set())
