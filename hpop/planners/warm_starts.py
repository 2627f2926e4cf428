"""The planner whose trajectories others start from: by name, with shared options, or with options of its own."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any

from hpop.errors import OptionError
from hpop.planners.base import Candidates, Planner, make_planner, sweeps
from hpop.registry import planners
from hpop.status import ProgressCallback
from hpop.text import shown

if TYPE_CHECKING:
    from hpop.problem import Problem

WarmStart = str | Mapping[str, Mapping[str, Any]]


def warm_planner(spec: WarmStart, *, step: float, headings: int, time_limit: float | None) -> Planner:
    """The planner that is named, with those of the options that it has.

    One that comes with options of its own, ``{name: {option: value}}``, shares the time limit alone, and that only if
    it has none.

    Raises OptionError for what names no planner or gives it options that it does not take.
    """
    if isinstance(spec, Mapping):
        if len(spec) != 1:
            raise OptionError(f"warm_start is one planner with its options, got {shown(spec)}")
        ((name, own),) = spec.items()
        if not isinstance(own, Mapping | None):
            raise OptionError(f"warm_start gives the options of {shown(name)} by their names, got {shown(own)}")
        shared: dict[str, Any] = {} if time_limit is None else {"time_limit": time_limit}
    elif isinstance(spec, str):
        name, own, shared = spec, {}, {"step": step, "headings": headings, "time_limit": time_limit}
    else:
        raise OptionError(f"warm_start is the name of a planner, or {{name: options}}, got {shown(spec)}")
    known = {option.name for option in dataclasses.fields(planners[name])}
    return make_planner(name, {option: v for option, v in shared.items() if option in known} | dict(own or {}))


def plan_warm_starts(
    planner: Planner, problem: Problem, progress: ProgressCallback | None, executor: Executor | None
) -> Candidates:
    """What the planner of the warm starts finds, on the executor if it sweeps."""
    if executor is not None and sweeps(planner):
        return planner.solve(problem, progress, executor=executor)
    return planner.solve(problem, progress)
