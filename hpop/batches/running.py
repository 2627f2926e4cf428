"""Runner of a batch: solves cases in this process, in processes of this machine, or on Dask or Ray, and saves them.

What several cases share (world, robot, criteria) is sent to each worker only once. If a worker dies, the case that
killed it gets a row with the error; other cases that were being solved are solved again.
"""

from __future__ import annotations

import json
import math
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np

from hpop import __version__
from hpop.base.options import MOST_WORKERS, whole
from hpop.batches.cases import Case, Cases, OfProblems, Specification
from hpop.batches.results import Results, Writer
from hpop.criteria.base import Criterion
from hpop.errors import HpopError, OptionError, OutputError
from hpop.motions import Model
from hpop.planners.base import Planner, PlannerSpec
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.runtime.interrupts import interrupts_held
from hpop.runtime.limits import Status, peak_memory
from hpop.runtime.sweep import Sweep, processes
from hpop.world import World

SLOTS = 32  # number of cases sent at once to an executor that does not report its number of workers
POLL = 0.1  # s between two checks for Ctrl-C
UNREACHABLE = (
    "the workers cannot be reached; finished cases are saved, and running the batch again continues from there"
)
DIED = "the worker process that solved this case died: it was killed, ran out of memory or crashed"
VERSIONS = f"hpop {__version__}; numpy {np.__version__}; python {platform.python_version()}"


@dataclass(frozen=True)
class Setting:
    """Arguments of :class:`hpop.Problem` that several cases share; sent to each worker only once."""

    world: World
    model: Model
    criteria: tuple[Criterion, ...]
    quanta: Mapping[str, float]
    horizon: float | None


@dataclass(frozen=True)
class CaseTask:
    """Start, goal and planners of a case: everything that is not part of its :class:`Setting`."""

    start: tuple[float, ...]
    goal: Any
    planners: tuple[Planner, ...]


@dataclass(frozen=True)
class BatchProgress:
    """Progress of a batch, for a callback.

    done, count  number of cases that have rows, and of all cases
    failed       number of cases that ended with an error since the batch was started
    seconds      s  since the batch was started
    left         s  estimate of the remaining time; nan while there is no estimate
    """

    done: int
    count: int
    failed: int
    seconds: float
    left: float


def solve(shared: Setting, task: CaseTask) -> list[dict[str, Any]]:
    """Solve a case and return its rows: one for each trajectory, or a single row that says why there is none.

    An error of the problem, the planner or the user's own code is stored in ``error``. After Ctrl-C there are no rows.
    """
    wall, processor = time.perf_counter(), time.process_time()
    front: Front | None = None
    error = None
    try:
        problem = Problem(
            shared.world,
            shared.model,
            task.start,
            task.goal,
            shared.criteria,
            quanta=shared.quanta,
            horizon=shared.horizon,
        )
        for front in problem.fronts(task.planners):
            if Status.INTERRUPTED in front.status:
                return []
    except Exception as failure:  # stored in the row, so that the batch continues
        error = f"{type(failure).__name__}: {failure}"
    common: dict[str, Any] = {
        "status": "error" if error is not None or front is None else front.status,
        "error": error,
        "seconds": time.perf_counter() - wall,
        "processor_seconds": time.process_time() - processor,
        "memory": peak_memory(),
        "seed": next((planner.seed for planner in task.planners if planner.seed is not None), None),
        "versions": VERSIONS,
    }
    if front is None or error is not None:
        return [common]
    runs = [run for run in front.runs if isinstance(run, Mapping)]
    common |= {
        "certificate": front.certificate,
        "points": len(front),
        "labels": sum(int(run.get("labels_generated", 0)) for run in runs),
        "units": dict(zip(front.names, front.units, strict=True)),
    }
    if not len(front):
        return [common]
    return [
        {
            **common,
            "row": point.index,
            "costs": {**point.costs, **point.reported},
            "provenance": json.dumps(point.provenance, default=str),
            "trajectory": json.dumps(point.trajectory.describe()),
        }
        for point in front
    ]


def batch(
    problems: str | Path | Iterable[Problem] | Mapping[str, Problem],
    planners: PlannerSpec | Sequence[PlannerSpec] | Mapping[str, PlannerSpec] = "lattice",
    *,
    out: str | Path,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: Callable[[BatchProgress], None] | None = None,
) -> Results:
    """Solve many problems by several planners, and keep the results in one Parquet data set.

    Each result is saved at once: after Ctrl-C, kill -9 or a power cut, call the function again with the same ``out``,
    and it continues with the cases that have no row yet. A case that fails gets a row with its error.

    Parameters
    ----------
    problems : a list, or by name; or the path of a specification, a scenario with ``vary`` or ``table``
    planners : each solves each problem by itself; a list, or by label. Ignored for a specification, which names its own
    out : folder of the results; created if missing
    workers : number of processes on this machine; None or 1 solves in this process
    executor : workers elsewhere, such as :func:`hpop.runtime.sweep.dask` gives
    progress : called after each case

    Raises OptionError if both workers and executor are given or workers is invalid, ScenarioError for an invalid
    specification, ImportError without the extra hpop[tables].

    >>> import hpop, shapely, tempfile
    >>> world = hpop.World.from_polygons([shapely.box(3, 0, 4, 3)], extent=shapely.box(0, 0, 8, 6))
    >>> robot = hpop.DifferentialDrive(radius=0.3)
    >>> problems = [hpop.Problem(world, robot, (1, 1, 0), (7, y, None), ["turns", "length"]) for y in (1, 5)]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     results = hpop.batch(problems, {"lattice": {"step": 1.0}}, out=folder)
    ...     results.table(["case", "row"]).to_pydict()
    {'case': [0, 0, 0, 1, 1], 'row': [0, 1, 2, 0, 1]}
    """
    if workers is not None and executor is not None:
        raise OptionError("give workers or an executor, not both")
    if isinstance(problems, str | Path):
        cases: Cases = Specification.load(problems)
    else:
        cases = OfProblems.of(problems, planners)
    run_cases(cases, Path(out), workers=workers, executor=executor, progress=progress)
    return Results(out)


def run_cases(
    cases: Cases,
    out: Path,
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: Callable[[BatchProgress], None] | None = None,
    again: bool = False,
) -> None:
    """Solve the cases that have no row in the folder ``out``; with ``again`` also those that ended with an error."""
    listed = list({case.id: case for case in cases}.values())  # a case that is given twice is solved once
    with Writer(out, again=again) as writer:
        order = {world: place for place, world in enumerate(dict.fromkeys(case.world for case in listed))}
        open_cases = sorted((case for case in listed if case.id not in writer.done), key=lambda case: order[case.world])
        begin, failed, done = time.monotonic(), 0, 0

        def tell() -> None:
            seconds = time.monotonic() - begin
            left = seconds / done * (len(open_cases) - done) if done else math.nan
            if progress is not None:
                progress(BatchProgress(len(listed) - len(open_cases) + done, len(listed), failed, seconds, left))

        tell()
        with Workers(workers, executor) as pool:
            for case, rows in pool.finished_cases(_jobs(cases, open_cases)):
                writer.write(case, rows)
                done += 1
                failed += rows[0]["error"] is not None
                tell()


@dataclass(frozen=True, eq=False)
class Job:
    """Case to be solved, with the data for a worker; or with a finished row, if its problem cannot be built."""

    case: Case
    shared: Setting | None = None
    task: CaseTask | None = None
    row: Mapping[str, Any] | None = None

    @property
    def parts(self) -> tuple[Setting, CaseTask]:
        """Setting and task of the case, the arguments of `solve`."""
        assert self.shared is not None
        assert self.task is not None
        return self.shared, self.task


def _jobs(cases: Cases, listed: Iterable[Case]) -> Iterator[Job]:
    """Yield a job for each case; successive cases with equal world, model and criteria share one :class:`Setting`."""
    common: Setting | None = None
    name = None
    for case in listed:
        try:
            problem, planners = cases.build(case)
        except HpopError as error:
            yield Job(case, row=_error_row(f"{type(error).__name__}: {error}"))
            continue
        world = problem.world
        if common is None or name != case.world:
            common = Setting(world, problem.model, problem.criteria, problem.quanta, problem.horizon)
            name = case.world
        # Worlds with equal digests may still differ in the people who touch the robot at its start.
        is_same = world.ground is common.world.ground and world.content == common.world.content
        shared = common if is_same else replace(common, world=world)
        yield Job(case, shared, CaseTask(problem.start, problem.goal, planners))


def _error_row(error: str) -> dict[str, Any]:
    """Return the row of a case that ended with an error."""
    return {"status": "error", "error": error, "versions": VERSIONS}


Rows = list[dict[str, Any]]


class Workers:
    """Workers that solve the cases of a batch: processes of this machine, a given executor, or this process."""

    def __init__(self, workers: int | None, executor: Executor | None) -> None:
        self._count = 1 if workers is None else whole("workers", workers, 1, MOST_WORKERS, "a number of processes")
        self._executor = executor
        self._slots = SLOTS if executor is not None else self._count
        self._owned = False
        self._ended: SimpleQueue[Future[Any]] = SimpleQueue()
        self._pending: dict[Future[Any], Job] = {}
        self._sweep: tuple[Setting, Sweep[Setting, CaseTask, Rows]] | None = None
        self._sweeps = ExitStack()

    def __enter__(self) -> Workers:
        if self._executor is None and self._count > 1:
            self._executor, self._owned = processes(self._count), True
        return self

    def __exit__(self, *_: object) -> None:
        with interrupts_held():
            for future in self._pending:
                future.cancel()
            self._sweeps.close()
            if self._owned and self._executor is not None:
                self._executor.shutdown(wait=True, cancel_futures=True)

    def finished_cases(self, jobs: Iterator[Job]) -> Iterator[tuple[Case, Rows]]:
        """Yield each case with its rows as soon as it is finished; raise KeyboardInterrupt after Ctrl-C."""
        if self._executor is None:
            for job in jobs:
                rows = [dict(job.row)] if job.row is not None else solve(*job.parts)
                if not rows:
                    raise KeyboardInterrupt
                yield job.case, rows
            return
        for job in jobs:
            if job.row is not None:
                yield job.case, [dict(job.row)]
                continue
            self._send(job)
            while len(self._pending) >= self._slots:
                yield from self._ended_cases()
        while self._pending:
            yield from self._ended_cases()

    def _ended_cases(self) -> Iterator[tuple[Case, Rows]]:
        """Wait up to ``POLL`` s for a case to end, and yield it with its rows; yield nothing if none has rows by then.

        After the death of a worker process, all open cases are solved again, one at a time, and yielded.
        """
        try:
            future = self._ended.get(timeout=POLL)
        except Empty:
            return
        job = self._pending.pop(future, None)
        if job is None:
            return
        try:
            rows = self._result_rows(future, job)
        except BrokenExecutor as error:
            if not self._owned:
                raise OutputError(f"{UNREACHABLE} ({error})") from None
            at_work = [job, *self._pending.values()]
            self._pending.clear()
            self._renew()
            for lost in at_work:
                yield lost.case, self._solve_alone(lost)
            return
        if rows is not None:
            yield job.case, rows

    def _solve_alone(self, job: Job) -> Rows:
        """Solve one case while no other is being solved, and return its rows.

        If a worker dies now, this case is the cause: it gets a row with the error, and the workers are replaced.
        """
        self._send(job)
        while True:
            (future,) = self._pending
            while not future.done():
                with suppress(Empty):
                    self._ended.get(timeout=POLL)
            self._pending.clear()
            try:
                rows = self._result_rows(future, job)
            except BrokenExecutor:
                self._renew()
                return [_error_row(DIED)]
            if rows is not None:
                return rows

    def _renew(self) -> None:
        """Replace all worker processes by new ones."""
        with interrupts_held():
            assert self._executor is not None
            self._executor.shutdown(wait=True, cancel_futures=True)
            self._sweeps.close()
            self._sweep = None
            self._ended = SimpleQueue()
            self._executor = processes(self._count)

    def _result_rows(self, future: Future[Any], job: Job) -> Rows | None:
        """Return the rows of a finished case; if its worker lacked the `Setting`, send the case again, return None."""
        try:
            with interrupts_held():
                _, results = future.result()
        except BrokenExecutor:
            raise
        except CancelledError as error:
            raise OutputError(f"{UNREACHABLE} ({type(error).__name__})") from None
        except Exception as error:  # an error of the executor, such as a Dask worker that died repeatedly
            return [_error_row(f"the worker failed: {type(error).__name__}: {error}")]
        if results is None:
            self._send(job, with_shared=True)
            return None
        rows: Rows = results[0]
        if not rows:
            raise KeyboardInterrupt
        return rows

    def _send(self, job: Job, *, with_shared: bool = False) -> None:
        """Submit a case to the executor.

        with_shared  sends its `Setting` (world, robot, criteria) with it, for a worker that lacks these
        """
        shared, task = job.parts
        if self._sweep is None or self._sweep[0] is not shared:
            sweep = self._sweeps.enter_context(Sweep(solve, shared, self._executor))
            self._sweep = shared, sweep
        with interrupts_held():
            future = self._sweep[1].submit([task], with_shared=with_shared)
            if future is None:
                raise OutputError(f"{UNREACHABLE} ({'; '.join(self._sweep[1].notes)})")
            self._pending[future] = job
            future.add_done_callback(self._ended.put)
