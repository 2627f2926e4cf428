"""Motions of trajectories in batches, one law a batch, as criteria and collisions take them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.motions import Model, Motions, States, is_curve, laws_of
from hpop.motions.possible import extras

if TYPE_CHECKING:
    from hpop.trajectories.trajectory import Trajectory
    from hpop.world import World


def batches(trajectories: Sequence[Trajectory], world: World) -> Iterator[tuple[IntArray, Motions]]:
    """The motions of many trajectories of one model, grouped by law, each with the number of its trajectory."""
    if not trajectories:
        return
    model = trajectories[0].model
    names = dict.fromkeys(name for t in trajectories for name in t.states.names)
    nothing = {len(t): np.full(len(t) + 1, np.nan) for t in trajectories}  # what its laws do not need
    states = States(**{n: np.concatenate([getattr(t.states, n, nothing[len(t)]) for t in trajectories]) for n in names})
    times = np.concatenate([t.times for t in trajectories])
    sizes = np.array([len(t) for t in trajectories])
    owner = np.repeat(np.arange(len(trajectories)), sizes)
    begins = np.arange(owner.size) + owner  # every trajectory has one state more than motions
    first, second = (np.concatenate([t.turns[side] for t in trajectories]) for side in (0, 1))
    kinds = np.array([kind for t in trajectories for kind in t.kinds], dtype=str)
    for kind in dict.fromkeys(kinds.tolist()):
        index = np.flatnonzero(kinds == kind)
        yield owner[index], motions_of(world, model, kind, states, times, (first, second), index, begins[index])


def motions_of(
    world: World,
    model: Model,
    kind: str,
    states: States,
    times: FloatArray,
    turns: tuple[FloatArray, FloatArray],
    index: IntArray,
    begins: IntArray,
) -> Motions:
    """Motions under one law: their places among all motions, and the states at which they begin."""
    law, names = laws_of(model)[kind], (*model.space.names, *extras(model, (kind,)))
    start, end = (States(**{name: getattr(states, name)[at] for name in names}) for at in (begins, begins + 1))
    ended = (turns[0][index], turns[1][index]) if is_curve(law) else None
    return Motions(world, model, law, start, end, t0=times[begins], turns=ended)
