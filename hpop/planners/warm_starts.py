"""The planner whose trajectories others start from: by name, with shared options, or with options of its own."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any, Protocol

from hpop.errors import OptionError
from hpop.planners.base import Candidates, Planner, make_planner, sweeps
from hpop.registry import planners
from hpop.status import ProgressCallback, Status
from hpop.text import shown

if TYPE_CHECKING:
    from hpop.problem import Problem

WarmStart = str | Mapping[str, Mapping[str, Any]]


class Starting(Protocol):
    """A planner that starts from the trajectories of another one, and its options that it shares with that."""

    @property
    def warm_start(self) -> WarmStart: ...
    @property
    def step(self) -> float: ...
    @property
    def headings(self) -> int: ...
    @property
    def time_limit(self) -> float | None: ...


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


def warm_planner_of(starting: Starting, *, time_limit: float | None = None) -> Planner:
    """The planner that another one starts from; raises as :func:`warm_planner` does."""
    return warm_planner(starting.warm_start, step=starting.step, headings=starting.headings, time_limit=time_limit)


def plan_warm_starts(
    starting: Starting, problem: Problem, progress: ProgressCallback | None, executor: Executor | None
) -> Candidates:
    """What the planner of the warm starts finds, on the executor if it sweeps."""
    planner = warm_planner_of(starting, time_limit=starting.time_limit)
    if executor is not None and sweeps(planner):
        return planner.solve(problem, progress, executor=executor)
    return planner.solve(problem, progress)


def status_after(first: Status, go: Callable[[], Status]) -> Status:
    """The status of a plan whose warm starts ended with one, and what goes on from them with another.

    Ctrl-C keeps what is finished.
    """
    try:
        ended = go()
    except KeyboardInterrupt:
        ended = Status.INTERRUPTED
    return first if ended is Status.COMPLETE else ended
