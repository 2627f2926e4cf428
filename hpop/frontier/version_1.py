"""Files of version 1, in which every point stood with its costs, origin and item; they are read, no longer written."""

from __future__ import annotations

from typing import Any

import numpy as np

from hpop.frontier.columns import Kinds, numbers, parts

_POINT: Kinds = {
    "costs": list,
    "reported": list,
    "provenance": dict,
    "item": (dict, list, str, int, float, bool, type(None)),
}


def points(top: dict[str, Any]) -> dict[str, Any]:
    """What the points of a file hold, as version 2 keeps it in columns: the arguments of a front, items still encoded.

    Raises ValueError that says what was expected.
    """
    k, r = len(top["criteria"]), len(top["reported"])
    rows = [parts(point, f"points[{i}]", _POINT) for i, point in enumerate(top["points"])]
    costs = [numbers(row[0], f"points[{i}].costs", k) for i, row in enumerate(rows)]
    reported = [numbers(row[1], f"points[{i}].reported", r) for i, row in enumerate(rows)]
    return {
        "costs": np.array(costs, dtype=np.float64).reshape(len(rows), k),
        "reported": np.array(reported, dtype=np.float64).reshape(len(rows), r),
        "provenance": [row[2] for row in rows],
        "items": [row[3] for row in rows],
    }
