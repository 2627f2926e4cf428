"""Every criterion that comes with hpop, made: those of a target or a field are given one."""

from __future__ import annotations

from pathlib import Path

from hpop.base.registry import criteria
from hpop.criteria.base import Criterion, make_criterion

NAMES = tuple(name for name, cls in criteria.items() if cls.__module__.startswith("hpop."))
TARGET = (5.0, 4.5, 1.0)
LEARNT = Path(__file__).with_name("learnt.json")
NEEDED = {"target": TARGET, "file": str(LEARNT), "good": 60.0, "bad": 120.0, "limit": 90.0, "width": 20.0}  # ms
FINE = {"occlusion": {"radius": 1.0, "rays": 100}}  # the share of few rays jumps within a motion


def own_criterion(name: str) -> Criterion:
    """Return the criterion of a name with its required options, and default options unless those are coarse."""
    fields = criteria[name].__dataclass_fields__  # type: ignore[attr-defined]
    needed = {key: value for key, value in NEEDED.items() if key in fields}
    return make_criterion({name: {**needed, **FINE.get(name, {})}} if needed else name)
