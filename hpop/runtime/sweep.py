"""Sweeps: many small tasks on shared data, run by any ``concurrent.futures.Executor`` or in this process.

Results are equal whether tasks run here, in a process pool or on a cluster (:func:`dask`, :func:`ray`). Shared data are
sent once to each worker. Workers on this machine map one file into their memory. A worker on another machine requests
the data and gets them with a task; its other tasks wait until then.

If a process of a pool dies, Python closes the pool, and this process does all unfinished tasks. Other executors may
lose single tasks only; this process does these.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import platform
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, InvalidStateError, ProcessPoolExecutor
from contextlib import suppress
from functools import cached_property, partial
from itertools import count
from mmap import ACCESS_COPY, mmap
from pathlib import Path
from queue import Empty, SimpleQueue
from tempfile import TemporaryDirectory
from threading import Thread
from types import TracebackType
from typing import Any, Generic, Self, TypeVar
from uuid import uuid4

from hpop.base.options import MOST_WORKERS, whole
from hpop.errors import OptionError
from hpop.runtime.clusters import dask as dask
from hpop.runtime.clusters import ray as ray
from hpop.runtime.interrupts import ENDING, interrupts_held
from hpop.runtime.limits import Status

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")

POLL = 0.1  # s between two checks whether to stop
SHARE = 8  # a message has at most 1/SHARE of the unsent tasks, so that workers finish at about one time
ALIGNED = 64  # bytes: arrays begin at multiples of this, as compiled code expects

_held: dict[str, Any] = {}  # in a worker: shared data of its current sweep, by the key of the sweep


def _run_tasks(
    key: str, file: str, payload: bytes | None, job: Callable[[Any, Any], R], tasks: Sequence[Any], _number: int
) -> tuple[str, list[R] | None]:
    """Run tasks in a worker; return the worker's name and the results, or None if the worker lacks the shared data.

    key       key of the sweep, under which a worker stores the shared data
    file      path of a file with the shared data, for a worker on this machine
    payload   pickled shared data, for a worker on another machine; None if they are not sent
    _number   number that makes messages different; to an equal message Dask would return the earlier result
    """
    shared = _held.get(key)
    if shared is None:
        if payload is not None:
            shared = pickle.loads(payload)
        else:
            try:
                shared = _load_mapped(Path(file))
            except OSError:
                return _worker_name(), None
        _held.clear()
        _held[key] = shared
    return _worker_name(), [job(shared, task) for task in tasks]


def _worker_name() -> str:
    """Return the name of this worker: its machine and process number."""
    return f"{platform.node()} {os.getpid()}"


def _write_mapped(shared: Any, file: Path) -> None:
    """Write a value to a file that :func:`_load_mapped` reads; its arrays are at the end, as they are in memory."""
    arrays: list[pickle.PickleBuffer] = []
    pickled = pickle.dumps(shared, protocol=5, buffer_callback=arrays.append)
    parts: list[bytes | memoryview] = [pickled, *(array.raw() for array in arrays)]
    begin, spans = 0, []
    for part in parts:
        spans.append((begin, begin + len(part)))
        begin += -(-len(part) // ALIGNED) * ALIGNED
    head = pickle.dumps(spans)
    with file.open("wb") as out:
        out.write(len(head).to_bytes(ALIGNED, "little"))
        out.write(head.ljust(-(-len(head) // ALIGNED) * ALIGNED))
        for part in parts:
            out.write(part)
            out.write(bytes(-len(part) % ALIGNED))


def _load_mapped(file: Path) -> Any:
    """Return the value in a file that :func:`_write_mapped` wrote.

    Its arrays are memory-mapped, so that all workers share the memory until one writes to an array.
    """
    with file.open("rb") as source:
        content = memoryview(mmap(source.fileno(), 0, access=ACCESS_COPY))
    size = int.from_bytes(content[:ALIGNED], "little")
    begin = ALIGNED - (-size // ALIGNED) * ALIGNED
    spans = pickle.loads(content[ALIGNED : ALIGNED + size])
    pickled, *arrays = (content[begin + first : begin + last] for first, last in spans)
    return pickle.loads(pickled, buffers=arrays)


class Sweep(Generic[S, T, R]):
    """Runner of ``job(shared, task)`` for many tasks, on an executor or in this process.

    job       function of a module that workers can import; its results must depend on its arguments only
    shared    data for all tasks, not None; data, tasks and results must be picklable
    executor  any executor; None to run the tasks in this process, one after another
    chunk     largest number of tasks in one message to a worker; if the tasks of a message take some tenths of a second
              together, sending costs little
    notes     sentences for the user on failures of the executor

    >>> with Sweep(pow, 2) as sweep:
    ...     dict(sweep.run([3, 4]))
    {0: 8, 1: 16}
    """

    def __init__(
        self, job: Callable[[S, T], R], shared: S, executor: Executor | None = None, *, chunk: int = 1
    ) -> None:
        self.job, self.shared, self.executor, self.chunk = job, shared, executor, max(1, chunk)
        self.notes: list[str] = []
        self._key = uuid4().hex
        self._numbers = count()
        self._folder: TemporaryDirectory[str] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._folder is not None:
            self._folder.cleanup()

    def run(self, tasks: Sequence[T], stop: Callable[[], bool] = lambda: False) -> Iterator[tuple[int, R]]:
        """Run all tasks; yield index and result of each task when it finishes. Stop early once ``stop()`` is true.

        If a task fails on the executor, or the executor fails, a note is added to ``notes``, and the tasks without a
        result are run again in this process. An error of a task is then raised here.
        """
        remaining = list(range(len(tasks)))
        if self.executor is not None and tasks:
            remaining = []
            yield from self._run_on_executor(tasks, stop, remaining)
        for i in remaining:
            if stop():
                return
            yield i, self.job(self.shared, tasks[i])

    def until(
        self,
        tasks: Sequence[T],
        stop: Callable[[], bool],
        report: Callable[[Mapping[int, R]], None] = lambda results: None,
    ) -> tuple[dict[int, R], Status]:
        """Run all tasks until ``stop()`` is true or Ctrl-C comes; return the results and the status.

        Results are by the index of their task, in order. The status is COMPLETE if all tasks were done, else TIME_LIMIT
        (after ``stop()``) or INTERRUPTED. ``report`` is called with the results so far, at first and after each result.
        """
        results: dict[int, R] = {}
        status = Status.COMPLETE
        try:
            report(results)
            for index, result in self.run(tasks, stop):
                results[index] = result
                report(results)
            if len(results) < len(tasks):
                status = Status.TIME_LIMIT
        except KeyboardInterrupt:  # finished results count
            status = Status.INTERRUPTED
        return dict(sorted(results.items())), status

    def _run_on_executor(
        self, tasks: Sequence[T], stop: Callable[[], bool], lost: list[int]
    ) -> Iterator[tuple[int, R]]:
        """Run tasks on the executor; yield index and result of each.

        The indices of tasks that failed or could not be sent are added to ``lost``; those of tasks that ``stop`` ends
        early are not. Ctrl-C is delayed whenever futures take their locks (`concurrent.futures.wait` takes all of
        them), but not while this method waits for a result.
        """
        ended: SimpleQueue[Future[Any]] = SimpleQueue()
        pending: dict[Future[Any], range] = {}
        supplies: dict[Future[Any], str] = {}  # those with the shared data, and the worker that gets the data
        waiting: list[range] = []  # tasks that wait until the data have arrived at their worker

        def send(indices: range, worker: str | None = None) -> None:
            with interrupts_held():
                future = self.submit([tasks[i] for i in indices], with_shared=worker is not None)
                if future is None:
                    lost.extend(indices)
                    return
                pending[future] = indices
                if worker is not None:
                    supplies[future] = worker
                future.add_done_callback(ended.put)

        try:
            sent = 0
            while sent < len(tasks):
                more = max(1, min(self.chunk, (len(tasks) - sent) // SHARE))
                send(range(sent, sent + more))
                sent += more
            while pending and not stop():
                # Messages with data come last, since a worker may have requested the data before they arrived.
                for future in sorted(_ended_futures(ended), key=supplies.__contains__):
                    indices = pending.pop(future)
                    if supplies.pop(future, None) is not None:
                        for delayed in waiting:
                            send(delayed)
                        waiting.clear()
                    try:
                        with interrupts_held():
                            worker, results = future.result()
                    except (Exception, CancelledError) as error:
                        self._note_failure(error)
                        lost.extend(indices)
                        continue
                    if results is not None:
                        yield from zip(indices, results, strict=True)
                    elif worker in supplies.values():
                        waiting.append(indices)
                    else:
                        send(indices, worker)
        finally:
            with interrupts_held():
                for future in pending:
                    future.cancel()
        lost.sort()

    @cached_property
    def _pickled_shared(self) -> bytes:
        return pickle.dumps(self.shared, protocol=pickle.HIGHEST_PROTOCOL)

    def submit(self, tasks: list[T], *, with_shared: bool) -> Future[Any] | None:
        """Submit tasks to the executor and return their future; None if the executor has failed.

        The future's result is the worker's name and the results of the tasks, or None in place of the results if the
        worker lacks the shared data.
        """
        if self.executor is None:
            return None
        try:
            if self._folder is None:
                self._folder = TemporaryDirectory(prefix="hpop-sweep-", ignore_cleanup_errors=True)
                _write_mapped(self.shared, Path(self._folder.name) / self._key)
            file = str(Path(self._folder.name) / self._key)
            payload = self._pickled_shared if with_shared else None
            return self.executor.submit(_run_tasks, self._key, file, payload, self.job, tasks, next(self._numbers))
        except Exception as error:  # a full disk; an executor that is shut down, broken or out of reach
            self._note_failure(error, worker_lost=True)
            return None

    def _note_failure(self, error: BaseException, *, worker_lost: bool = False) -> None:
        """Add a note on an error of the executor, once for each kind of error; stop using a broken executor."""
        if worker_lost or isinstance(error, BrokenExecutor):
            self.executor = None
        note = (
            f"a worker process or its executor failed ({type(error).__name__}); its unfinished tasks were done in the "
            "main process"
        )
        if note not in self.notes:
            self.notes.append(note)


def _ended_futures(ended: SimpleQueue[Future[Any]]) -> list[Future[Any]]:
    """Wait shortly for a future to end, and return all futures that have ended."""
    try:
        futures = [ended.get(timeout=POLL)]
    except Empty:
        return []
    while not ended.empty():
        futures.append(ended.get())
    return futures


class _Processes(ProcessPoolExecutor):
    """Process pool that survives Ctrl-C at any moment."""

    def submit(self, fn: Callable[..., T], /, *arguments: Any, **named: Any) -> Future[T]:
        """Submit a task. Ctrl-C is delayed while a worker starts, so that no half-started worker is orphaned."""
        with interrupts_held():
            future = super().submit(fn, *arguments, **named)
        setattr(future, "set_exception", partial(_fail, future))  # noqa: B010
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers after their current tasks.

        Ctrl-C is delayed meanwhile. If it interrupted the wait for the pool's thread, that thread and the process would
        wait for ever.
        """
        with interrupts_held():
            super().shutdown(wait, cancel_futures=cancel_futures)


def _fail(future: Future[Any], error: BaseException | None) -> None:
    """Set the exception of a future, unless it is cancelled; in Python 3.11 that would end the pool's thread."""
    with suppress(InvalidStateError):
        Future.set_exception(future, error)


def processes(workers: int) -> ProcessPoolExecutor:
    """Return a pool of new worker processes on this machine; they ignore Ctrl-C, to which the main process reacts.

    Raises OptionError if the system cannot start processes, or has no locks that processes share (for example, because
    /dev/shm cannot be written).
    """
    workers = whole("workers", workers, 1, MOST_WORKERS, "a whole number of processes")
    method = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
    try:
        if method == "forkserver":
            _start_fork_server()
        return _Processes(workers, multiprocessing.get_context(method), _prepare_worker)
    except (OSError, ImportError, NotImplementedError) as error:
        reason = getattr(error, "strerror", None) or error
        raise OptionError(
            f"cannot start worker processes ({reason}); they need a writable /dev/shm and permission to start more "
            "processes. Plan without workers"
        ) from None


def _start_fork_server() -> None:
    """Start the server process that forks workers, protected from signals that end a group of processes.

    The server inherits the signals that are blocked here, and ends when the main process ends. The resource tracker is
    started first, because its start unblocks SIGTERM.
    """
    from multiprocessing import forkserver, resource_tracker

    resource_tracker.ensure_running()
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def _prepare_worker() -> None:
    """Prepare a worker process: it ignores Ctrl-C and has its own process group, since the main process ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "setpgid"):
        os.setpgid(0, 0)
        for number in ENDING:
            signal.signal(number, signal.SIG_IGN)  # drops signals that have arrived while blocked
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
        for number in ENDING:
            signal.signal(number, signal.SIG_DFL)
    Thread(target=_end_with, args=(multiprocessing.parent_process(),), daemon=True).start()


def _end_with(main: Any) -> None:
    """End this worker when the process ``main`` ends, even if that is killed; otherwise it would wait for ever."""
    main.join()
    os._exit(1)
