"""What a body does at some times, as a table: where it is, how fast it moves and turns; or the states themselves."""

from __future__ import annotations

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.base.table import Table
from hpop.base.text import shown
from hpop.errors import OptionError, did_you_mean
from hpop.motions.laws import Model
from hpop.motions.states import States

NO_BODIES = frozenset(
    {"heading", "joints", "plane", "rigid", "spline", "turn-move", "wheels"}
)  # what else models provide
POSE = {"x": "m", "y": "m", "z": "m", "yaw": "rad", "pitch": "rad", "roll": "rad"}
VELOCITY = ("vx", "vy", "vz")
ROTATION = ("wx", "wy", "wz")


def body_table(model: Model, body: str | None, times: FloatArray, states: States, rates: States) -> Table:
    """Time, pose, velocity and rotation of a body (N,), in the world's frame; of None the states and their rates.

    Raises OptionError for a body that the model does not have.
    """
    columns: list[tuple[str, str, Column]] = [("t", "s", times)]
    if body is None:
        space = dict(zip(model.space.names, model.space.units, strict=True))
        columns += [(name, unit, getattr(states, name)) for name, unit in space.items()]
        columns += [(f"{name}_rate", f"{unit}/s", getattr(rates, name)) for name, unit in space.items()]
    else:
        check_body(model, body, or_else=", or None for its states")
        pose, twist = model.pose(body, states), model.twist(body, states, rates)
        columns += [(name, unit, getattr(pose, name)) for name, unit in POSE.items()]
        columns += [(name, "m/s", column) for name, column in zip(VELOCITY, twist.velocity, strict=True)]
        columns += [(name, "rad/s", column) for name, column in zip(ROTATION, twist.rotation, strict=True)]
    names = [name for name, _, _ in columns]
    if len(set(names)) < len(names):
        raise OptionError(f"the states of this robot would be columns of one name ({', '.join(names)}); ask for a body")
    values = {name: np.array(np.broadcast_to(column, times.shape), float) for name, _, column in columns}
    return Table(values, {name: unit for name, unit, _ in columns})


def check_body(model: Model, body: str, *, or_else: str = "") -> None:
    """Raise OptionError for a body that the model does not have."""
    known = sorted(model.provides - NO_BODIES)
    if body not in known:
        raise OptionError(
            f"this robot has no body {shown(body)}.{did_you_mean(body, known)} "
            f"body is one of {', '.join(known)}{or_else}"
        )
