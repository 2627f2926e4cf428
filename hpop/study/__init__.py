"""Studies: what people say of trajectories of a front, from the choice of stimuli to the weights of one person."""

from __future__ import annotations

from hpop.lazy import on_first_use

__all__: list[str] = []

_HOMES: dict[str, str] = {}

__getattr__ = on_first_use(__name__, _HOMES)
