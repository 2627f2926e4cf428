"""Where a robot that is blocked could stand instead: the nearest place that is free, for whoever placed it by eye."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.motions import Model, States

if TYPE_CHECKING:
    from hpop.world import World

RINGS = ((0.05, 1.0), (0.1, 3.0), (0.5, 15.0), (2.0, 60.0), (10.0, 300.0))
"""Spacing of the places that are tried, m, and how far from the end: near to it closely."""
HEADINGS = 8
"""Headings that are tried where it is free."""
BLOCK = 512
"""Places that are looked at together; most often the first of them tell."""


def nearest_free(model: Model, world: World, state: States) -> States | None:
    """The state (1,) moved to the nearest place where the robot is free, among places with few decimals.

    Of angles that are free (NaN) the heading is one of eight, the others are 0. None where no place within 300 m is
    free, or the robot's states have no x and y.
    """
    if not {"x", "y"} <= set(model.space.names):
        return None
    collision = model.collision(world)
    for places in _places(world, float(state.x[0]), float(state.y[0])):
        tried = _at(state, places)
        free = np.flatnonzero(collision.states_free(tried))
        if free.size:
            return tried.take(free[:1])
    return None


def elsewhere(model: Model, world: World, state: States) -> str:
    """A sentence on that place, to be put after the reason why a state (1,) is blocked; nothing where there is none."""
    found = nearest_free(model, world, state)
    if found is None:
        return ""
    x, y = float(found.x[0]), float(found.y[0])
    away = float(np.hypot(x - state.x[0], y - state.y[0]))
    return f" The nearest place where the robot is free is ({x:.4g}, {y:.4g}), {away:.2f} m away."


def _places(world: World, x: float, y: float) -> Iterator[FloatArray]:
    """Places (N, 2), m, within the bounds of a world, ever farther from a point."""
    x0, y0, x1, y1 = world.bounds
    nearest = np.array([np.clip(x, x0, x1), np.clip(y, y0, y1)])  # of the map to a point beside it
    inner = -1.0
    for spacing, reach in RINGS:
        low = np.ceil(np.maximum(nearest - reach, (x0, y0)) / spacing)
        high = np.floor(np.minimum(nearest + reach, (x1, y1)) / spacing)
        grid = np.meshgrid(*(np.arange(a, b + 1) * spacing for a, b in zip(low, high, strict=True)))
        places = np.stack([axis.ravel() for axis in grid], axis=1).round(2)
        there = np.hypot(*(places - nearest).T)
        places = places[(there > inner) & (there <= reach)]
        places = places[np.argsort(np.hypot(*(places - (x, y)).T), kind="stable")]
        yield from (places[i : i + BLOCK] for i in range(0, len(places), BLOCK))
        inner = reach


def _at(state: States, places: FloatArray) -> States:
    """The state at each of some places (N, 2), at each heading that will do."""
    headings = np.arange(HEADINGS) * 2 * np.pi / HEADINGS if np.isnan(getattr(state, "yaw", np.zeros(1))[0]) else None
    count = 1 if headings is None else headings.size
    columns = {name: np.full(len(places) * count, np.nan_to_num(getattr(state, name)[0])) for name in state.names}
    columns |= {"x": np.repeat(places[:, 0], count), "y": np.repeat(places[:, 1], count)}
    if headings is not None:
        columns["yaw"] = np.tile(headings, len(places))
    return States(**columns)
