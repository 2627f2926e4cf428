"""Sweeps: many small jobs over the same data, on any ``concurrent.futures.Executor`` or none.

Serial, process pools and Dask (:func:`dask`) give the same results. What a job needs beside its own
task is shipped once: workers on this machine map one file into their memory. One elsewhere asks for it and gets it with
a job; what it could not do meanwhile waits for that. A worker that dies loses only what it was at: that is done again,
in this process.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import platform
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    InvalidStateError,
    ProcessPoolExecutor,
)
from contextlib import contextmanager, suppress
from functools import partial
from importlib import import_module
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
from hpop.runtime.interrupts import ENDING, interrupts_held
from hpop.runtime.status import Status

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")

POLL = 0.1  # s between two looks at whether to stop
SHARE = 8  # one message has at most one in so many of the tasks not sent yet, so that workers end together
CONNECT = 10  # s to wait for a scheduler
ALIGNED = 64  # bytes: arrays begin at multiples, as compiled code wants them

_held: dict[str, Any] = {}  # in a worker: the data of the sweep it works for


def _work(
    key: str, file: str, payload: bytes | None, job: Callable[[Any, Any], R], tasks: Sequence[Any], _number: int
) -> tuple[str, list[R] | None]:
    """Do some tasks in a worker: its name, and results, or None where the shared data did not come and are not here.

    The number tells messages apart: Dask takes equal ones for one, and may give the answer that it gave before.
    """
    shared = _held.get(key)
    if shared is None:
        if payload is not None:
            shared = pickle.loads(payload)
        else:
            try:
                shared = _mapped(Path(file))
            except OSError:
                return _name(), None
        _held.clear()
        _held[key] = shared
    return _name(), [job(shared, task) for task in tasks]


def _name() -> str:
    return f"{platform.node()} {os.getpid()}"


def _write(shared: Any, file: Path) -> None:
    """Write a value for :func:`_mapped`: its arrays as they are in memory, at the end of the file."""
    arrays: list[pickle.PickleBuffer] = []
    rest = pickle.dumps(shared, protocol=5, buffer_callback=arrays.append)
    parts: list[bytes | memoryview] = [rest, *(array.raw() for array in arrays)]
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


def _mapped(file: Path) -> Any:
    """Return the value in a file; its arrays stay there, in memory that all workers share until one writes to it."""
    with file.open("rb") as source:
        whole = memoryview(mmap(source.fileno(), 0, access=ACCESS_COPY))
    size = int.from_bytes(whole[:ALIGNED], "little")
    begin = ALIGNED - (-size // ALIGNED) * ALIGNED
    spans = pickle.loads(whole[ALIGNED : ALIGNED + size])
    rest, *arrays = (whole[begin + first : begin + last] for first, last in spans)
    return pickle.loads(rest, buffers=arrays)


class Sweep(Generic[S, T, R]):
    """Runs ``job(shared, task)`` for many tasks, on an executor or in this process.

    job       a function of a module that workers can import; its results depend on its arguments alone
    shared    what all tasks need, not None; picklable, as tasks and results are
    executor  any; None runs the tasks here, one after the other
    chunk     most tasks sent together: some tenths of a second of work hide the cost of sending
    notes     what went wrong with the executor, for the user

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
        self._payload = b""
        self._messages = 0
        self._folder: TemporaryDirectory[str] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._folder is not None:
            self._folder.cleanup()

    def run(self, tasks: Sequence[T], stop: Callable[[], bool] = lambda: False) -> Iterator[tuple[int, R]]:
        """Place and result of each task, as they finish; ends early once ``stop()`` is true.

        An error of a task is raised here. An error of the executor is noted, and what it lost is done here.
        """
        here = list(range(len(tasks)))
        if self.executor is not None and tasks:
            here = []
            yield from self._elsewhere(tasks, stop, here)
        for i in here:
            if stop():
                return
            yield i, self.job(self.shared, tasks[i])

    def until(
        self,
        tasks: Sequence[T],
        stop: Callable[[], bool],
        report: Callable[[Mapping[int, R]], None] = lambda results: None,
    ) -> tuple[dict[int, R], Status]:
        """Results by the places of their tasks, in that order; and whether ``stop()`` or Ctrl-C ended it before all.

        ``report(results)`` is called first, and after each result.
        """
        results: dict[int, R] = {}
        status = Status.COMPLETE
        try:
            report(results)
            for place, result in self.run(tasks, stop):
                results[place] = result
                report(results)
            if len(results) < len(tasks):
                status = Status.TIME_LIMIT
        except KeyboardInterrupt:  # what is finished is kept
            status = Status.INTERRUPTED
        return dict(sorted(results.items())), status

    def _elsewhere(self, tasks: Sequence[T], stop: Callable[[], bool], lost: list[int]) -> Iterator[tuple[int, R]]:
        """Yield results that the executor brings; the places of those that it does not are added to ``lost``.

        Ctrl-C is held wherever futures take their locks (`concurrent.futures.wait` takes all of them), but not while
        this waits for one to end.
        """
        ended: SimpleQueue[Future[Any]] = SimpleQueue()
        pending: dict[Future[Any], range] = {}
        supplies: dict[Future[Any], str] = {}  # those of them that bring the shared data, and who asked for these
        waiting: list[range] = []  # for the data to arrive

        def send(places: range, worker: str | None = None) -> None:
            with interrupts_held():
                future = self._submit([tasks[i] for i in places], with_shared=worker is not None)
                if future is None:
                    lost.extend(places)
                    return
                pending[future] = places
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
                # A worker asked before its data arrived.
                for future in sorted(_all_in(ended), key=supplies.__contains__):
                    places = pending.pop(future)
                    if supplies.pop(future, None) is not None:
                        for others in waiting:
                            send(others)
                        waiting.clear()
                    try:
                        with interrupts_held():
                            worker, results = future.result()
                    except (Exception, CancelledError) as error:
                        self._failed(error)
                        lost.extend(places)
                        continue
                    if results is not None:
                        yield from zip(places, results, strict=True)
                    elif worker in supplies.values():
                        waiting.append(places)
                    else:
                        send(places, worker)
        finally:
            with interrupts_held():
                for future in pending:
                    future.cancel()
        lost.sort()

    def _submit(self, tasks: list[T], *, with_shared: bool) -> Future[Any] | None:
        """Return hand tasks to the executor; None if it takes no more."""
        if self.executor is None:
            return None
        try:
            if self._folder is None:
                self._folder = TemporaryDirectory(prefix="hpop-sweep-", ignore_cleanup_errors=True)
                _write(self.shared, Path(self._folder.name) / self._key)
            file = str(Path(self._folder.name) / self._key)
            if with_shared:
                self._payload = self._payload or pickle.dumps(self.shared, protocol=pickle.HIGHEST_PROTOCOL)
            payload = self._payload if with_shared else None
            self._messages += 1
            return self.executor.submit(_work, self._key, file, payload, self.job, tasks, self._messages)
        except Exception as error:  # no place for a file; an executor that is shut down, broken or out of reach
            self._failed(error, worker_lost=True)
            return None

    def _failed(self, error: BaseException, *, worker_lost: bool = False) -> None:
        """Note an error of the executor, once of each kind; one that is broken is not asked again."""
        if worker_lost or isinstance(error, BrokenExecutor):
            self.executor = None
        note = (
            f"a worker or its executor failed ({type(error).__name__}); what it had not finished was done in the "
            "planning process"
        )
        if note not in self.notes:
            self.notes.append(note)


def _all_in(ended: SimpleQueue[Future[Any]]) -> list[Future[Any]]:
    """Return the futures that have ended since; waits a little for the first."""
    try:
        found = [ended.get(timeout=POLL)]
    except Empty:
        return []
    while not ended.empty():
        found.append(ended.get())
    return found


class _Processes(ProcessPoolExecutor):
    def submit(self, fn: Callable[..., T], /, *arguments: Any, **named: Any) -> Future[T]:
        """Return hand over a task; a worker that begins for it is begun whole, or it would be one that nobody ends."""
        with interrupts_held():
            future = super().submit(fn, *arguments, **named)
        setattr(future, "set_exception", partial(_fail, future))  # noqa: B010  (of this one alone)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers, once they have ended what they are at.

        Ctrl-C waits for that: one that comes into the join of the pool's own thread leaves it, and with it the process,
        waiting for ever.
        """
        with interrupts_held():
            super().shutdown(wait, cancel_futures=cancel_futures)


def _fail(future: Future[Any], error: BaseException | None) -> None:
    """Give a future its exception; Python 3.11 gives one to those that are cancelled too, and ends its thread so."""
    with suppress(InvalidStateError):
        Future.set_exception(future, error)


def processes(workers: int) -> ProcessPoolExecutor:
    """Return a pool of fresh processes on this machine; Ctrl-C and other ends of a group are for the planning process.

    Raises OptionError where the system has no locks that processes share, as where /dev/shm cannot be written, or
    cannot begin a process.
    """
    workers = whole("workers", workers, 1, MOST_WORKERS, "a whole number of processes")
    method = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
    try:
        if method == "forkserver":
            _serve_forks()
        return _Processes(workers, multiprocessing.get_context(method), _begin)
    except (OSError, ImportError, NotImplementedError) as error:
        reason = getattr(error, "strerror", None) or error
        raise OptionError(
            f"no worker processes can be had here ({reason}); they need a /dev/shm that can be written, and free "
            "processes. Plan without workers"
        ) from None


def _serve_forks() -> None:
    """Start the process that workers come from so that what ends a group of processes does not end that one.

    It inherits what is blocked, and ends with the process that plans. What it needs besides comes first: to start that
    unblocks SIGTERM.
    """
    from multiprocessing import forkserver, resource_tracker

    resource_tracker.ensure_running()
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def _begin() -> None:
    """Begin a worker: signals to the group are for the process that plans, which ends its workers itself."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "setpgid"):
        os.setpgid(0, 0)
        for number in ENDING:
            signal.signal(number, signal.SIG_IGN)  # drops what came while this began
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
        for number in ENDING:
            signal.signal(number, signal.SIG_DFL)
    Thread(target=_end_with, args=(multiprocessing.parent_process(),), daemon=True).start()


def _end_with(planning: Any) -> None:
    """End a worker with the process that plans, also where that is killed: else it waits for tasks for ever."""
    planning.join()
    os._exit(1)


class _Cluster(Executor):
    """The workers of a Dask client.

    Dask's own executor leaves a job open for ever where the scheduler dies while its result is on the way.
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    def submit(self, fn: Callable[..., T], /, *arguments: Any, **named: Any) -> Future[T]:
        there = self._client.submit(fn, *arguments, **named, pure=False)
        here: Future[T] = Future()
        here.add_done_callback(lambda ended: there.cancel() if ended.cancelled() else None)
        self._client.loop.add_callback(_answer, there, here)
        return here


async def _answer(there: Any, here: Future[Any]) -> None:
    """Copy the outcome of a Dask job to its future."""
    try:
        result = await there
    except Exception as error:
        if here.set_running_or_notify_cancel():
            here.set_exception(error)
    else:
        if here.set_running_or_notify_cancel():
            here.set_result(result)


@contextmanager
def dask(address: str) -> Iterator[Executor]:
    """Connect to the workers of a Dask scheduler, such as ``tcp://host:8786``, with hpop installed.

    Raises OptionError where the extra hpop[dask] is not installed, or no scheduler answers.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError as error:
        raise OptionError(
            f"a Dask cluster needs the extra hpop[dask] ({error}); pip install 'hpop[dask]', or use workers of this "
            "machine"
        ) from None
    try:
        client = distributed.Client(address, timeout=CONNECT)
    except (OSError, ValueError) as error:
        raise OptionError(
            f"no Dask scheduler answers at {address!r} ({error}); start one with `dask scheduler`, which says its "
            "address"
        ) from None
    with client:
        yield _Cluster(client)
