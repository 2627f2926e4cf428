"""Every criterion that comes with hpop, made: those of a target are given one."""

from __future__ import annotations

from hpop.criteria.base import Criterion, make_criterion
from hpop.registry import criteria

NAMES = tuple(name for name, cls in criteria.items() if cls.__module__.startswith("hpop."))
TARGET = (5.0, 4.5, 1.0)
FINE = {"occlusion": {"radius": 1.0, "rays": 100}}  # the share of few rays jumps within a motion


def own_criterion(name: str) -> Criterion:
    """The criterion of a name with what must be given, all else as it is by default but where that is coarse."""
    targeted = "target" in criteria[name].__dataclass_fields__  # type: ignore[attr-defined]
    return make_criterion({name: {"target": TARGET, **FINE.get(name, {})}} if targeted else name)
