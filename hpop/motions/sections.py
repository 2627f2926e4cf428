"""Sections of motions: what is done of each from one moment to another.

A law leads between the ends of a section as it does there within the whole motion; only its timing would be another, as
one that goes from rest to rest. So a section has the geometry of its law and the phases of the whole motion, clipped.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from hpop.base.arrays import Column, FloatArray, IntArray
from hpop.motions.batch import Motions
from hpop.motions.laws import Phase
from hpop.motions.states import States


@dataclass(frozen=True, eq=False)
class Sections(Motions):
    """A batch of sections of motions under one law.

    timing  phases of the whole motions, clipped to the sections, with shares of these
    """

    timing: tuple[Phase, ...] = ()

    whole: ClassVar[bool] = False

    @cached_property
    def phases(self) -> tuple[Phase, ...]:
        """The timing of the whole motions."""
        return self.timing


def sections(
    whole: Motions,
    owner: IntArray,
    since: FloatArray,
    until: FloatArray,
    ends: tuple[States, States],
    turns: tuple[FloatArray, FloatArray] | None,
) -> Sections:
    """Sections (P,) of some motions.

    Parameters
    ----------
    whole : the motions (M,)
    owner : (P,) place of the motion of which each is a part
    since, until : (P,) s from the start of the motion
    ends : states (P,) at these moments
    turns : (P,) rad, two columns, as of :class:`Motions`
    """
    t0 = None if whole.t0 is None else whole.t0[owner] + since
    timing = _clipped(whole, owner, since, until)
    return Sections(whole.world, whole.model, whole.law, *ends, t0=t0, turns=turns, timing=timing)


def _clipped(whole: Motions, owner: IntArray, since: FloatArray, until: FloatArray) -> tuple[Phase, ...]:
    """Phases (P,) of what lies between two moments."""

    def pick(column: Column) -> FloatArray:
        return np.broadcast_to(column, len(whole))[owner]

    first, last, elapsed = np.zeros(owner.size), np.zeros(owner.size), np.zeros(owner.size)
    parts = list[Phase]()
    for phase in whole.phases:
        picked = Phase(pick(phase.duration), pick(phase.begin), pick(phase.end), phase.shape, pick(phase.change))
        lasts = np.where(picked.duration > 0, picked.duration, 1.0)
        begin, end = (np.clip((moment - elapsed) / lasts, 0.0, 1.0) for moment in (since, until))
        first = np.where(since >= elapsed, picked.share(begin), first)
        last = np.where(until >= elapsed, picked.share(end), last)
        parts.append(picked.part(begin, end))
        elapsed = elapsed + picked.duration
    span = np.where(last > first, last - first, 1.0)
    return tuple(
        part._replace(**{name: np.clip((getattr(part, name) - first) / span, 0.0, 1.0) for name in ("begin", "end")})
        for part in parts
    )
