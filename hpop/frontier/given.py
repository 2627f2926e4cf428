"""What a front takes for granted where its maker does not say it: names, units, and which columns are maximised."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hpop.frontier.dominance import FloatArray, cost_matrix
from hpop.frontier.errors import FrontError
from hpop.text import shown


def names_of(costs: ArrayLike, names: Sequence[str] | None) -> tuple[str, ...]:
    """Names of the columns: as given, those of a table of pandas, or "f1", "f2", ...

    >>> names_of([[1.0, 2.0]], None)
    ('f1', 'f2')
    """
    if names is not None:
        return (names,) if isinstance(names, str) else tuple(names)
    columns = getattr(costs, "columns", None)
    if columns is not None:
        return tuple(str(name) for name in columns)
    return tuple(f"f{j + 1}" for j in range(cost_matrix(costs).shape[1]))


def minimised(
    matrix: FloatArray, names: tuple[str, ...], maximise: Sequence[str] | Sequence[bool]
) -> tuple[FloatArray, tuple[str, ...]]:
    """Costs and names with the columns to maximise turned round: minus the value, under its name with a minus.

    >>> minimised(np.array([[1.0, 2.0]]), ("length", "view"), ["view"])
    (array([[ 1., -2.]]), ('length', '-view'))
    """
    given: Any = [maximise] if isinstance(maximise, str) else maximise
    try:
        flags = [bool(one) for one in given] if all(isinstance(one, bool | np.bool_) for one in given) else None
    except TypeError:
        flags, given = None, [maximise]
    if flags is None:
        strange = [one for one in given if one not in names]
        if strange:
            raise FrontError(
                f"maximise has names of costs, or a bool for each of {', '.join(names)}, got {shown(maximise)}"
            )
        flags = [name in given for name in names]
    if flags and len(flags) != len(names):
        raise FrontError(f"maximise has {len(flags)} bools for the {len(names)} costs {', '.join(names)}")
    if not any(flags):
        return matrix, names
    sign = np.where(flags, -1.0, 1.0)
    turned = tuple(f"-{name}" if flag else name for name, flag in zip(names, flags, strict=True))
    return matrix * sign + 0.0, turned
