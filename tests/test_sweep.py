"""Sweeps: the same results on every executor, whatever happens to it; workers of a pool and of Dask that are killed."""

from __future__ import annotations

import operator
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hpop.errors import OptionError
from hpop.runtime import clusters
from hpop.runtime import sweep as module
from hpop.runtime.limits import Progress
from hpop.runtime.sweep import Sweep, dask, processes
from hpop.search import Graph, SupportedPaths, supported_paths
from tests.interrupted import interrupted_locks

TASKS = list(range(10))
EXPECTED = {i: 7 * i for i in TASKS}


class Faulty(Executor):
    """Runs jobs at once; from the given one on (counted from 0) it breaks as told, "submit" or "result"."""

    def __init__(self, breaks: str, first: int, error: type[BaseException]) -> None:
        self.breaks, self.first, self.error, self.jobs = breaks, first, error, 0

    def submit(self, fn: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        self.jobs += 1
        bad = self.jobs > self.first
        if bad and self.breaks == "submit":
            raise self.error("cannot")
        future: Future[Any] = Future()
        if bad:
            future.set_exception(self.error("lost"))
        else:
            future.set_result(fn(*arguments, **named))
        return future


class Elsewhere(Executor):
    """One worker on another machine: no file of ours is there. Counts the shared data that it is sent."""

    def __init__(self) -> None:
        self.sent = 0

    def submit(self, fn: Any, key: str, file: str, payload: bytes | None, /, *rest: Any) -> Future[Any]:  # type: ignore[override]
        self.sent += payload is not None
        future: Future[Any] = Future()
        future.set_result(fn(key, file + ".not-here", payload, *rest))
        return future


@pytest.fixture(autouse=True)
def _forget() -> None:
    module._held.clear()


@pytest.mark.parametrize("chunk", [1, 3, 100])
def test_every_task_is_done_once(chunk: int) -> None:
    with ThreadPoolExecutor(2) as pool:
        for executor in (None, pool, Elsewhere()):
            with Sweep(operator.mul, 7, executor, chunk=chunk) as sweep:
                results = list(sweep.run(TASKS))
                again = dict(sweep.run(TASKS))
            assert dict(results) == again == EXPECTED
            assert len(results) == len(TASKS)
            assert sweep.notes == []


def seen(shared: dict[str, Any], task: str) -> tuple[Any, ...]:
    """Describe the array of a job: values, type, if it may be written, and if compiled code takes it as it is."""
    array = shared[task]
    was = array.tolist()
    if array.flags.writeable and array.size:
        array.flat[0] = 99
    return was, array.shape, str(array.dtype), array.flags.writeable, array.flags.aligned


def test_arrays_arrive_as_they_are_and_what_a_worker_writes_stays_there() -> None:
    def shared() -> dict[str, Any]:
        read_only = np.arange(6.0)
        read_only.setflags(write=False)
        return {
            "odd bytes": np.array([1, 2, 3], np.uint8),
            "matrix": np.arange(12, dtype=np.int32).reshape(4, 3),
            "transposed": np.arange(6.0).reshape(2, 3).T,
            "none": np.zeros((0, 3), np.int64),
            "read only": read_only,
            "scattered": np.arange(10)[::3],
        }

    names = list(shared())
    given = shared()
    with processes(1) as pool, Sweep(seen, given, pool) as sweep:
        there = dict(sweep.run(names))
    expected = shared()
    assert sweep.notes == []
    assert [there[i] for i in range(len(names))] == [seen(expected, name) for name in names]
    assert given["matrix"][0, 0] == 0


def test_a_worker_elsewhere_is_sent_the_shared_data_once_and_keeps_them() -> None:
    far = Elsewhere()
    with Sweep(operator.mul, 7, far) as sweep:
        for _ in range(5):
            assert dict(sweep.run(TASKS)) == EXPECTED
    assert far.sent == 1


@pytest.mark.parametrize("seed", range(5))
def test_each_of_many_workers_elsewhere_is_sent_the_shared_data(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Jobs come to any of three machines in unforeseen turns, so one machine may get a job meant for another."""
    draw = np.random.default_rng(seed)
    memories: dict[str, dict[str, Any]] = {"a": {}, "b": {}, "c": {}}

    class Far(Elsewhere):
        def submit(self, *arguments: Any) -> Future[Any]:  # type: ignore[override]
            machine = str(draw.choice(list(memories)))
            monkeypatch.setattr(module, "_held", memories[machine])
            monkeypatch.setattr(module, "_worker_name", lambda: machine)
            return super().submit(*arguments)

    far = Far()
    with Sweep(operator.mul, 7, far) as sweep:
        for _ in range(20):
            assert dict(sweep.run(TASKS)) == EXPECTED
    assert all(memories.values())
    assert far.sent <= 12  # tasks: 200


class InTurn(Elsewhere):
    """One worker elsewhere that takes messages in turn; equal ones get the answer that the first got, as from Dask."""

    def __init__(self) -> None:
        super().__init__()
        self.queue: list[tuple[Future[Any], Any]] = []
        self.answers: dict[bytes, Any] = {}

    def submit(self, fn: Any, /, *arguments: Any) -> Future[Any]:  # type: ignore[override]
        self.queue.append((Future(), (fn, *arguments)))
        return self.queue[-1][0]

    def work(self, messages: int) -> None:
        for future, message in self.queue[:messages]:
            known = pickle.dumps(message)
            if known not in self.answers:
                self.answers[known] = super().submit(*message).result()
            future.set_result(self.answers[known])
        del self.queue[:messages]


@pytest.mark.parametrize("together", range(1, 12))
def test_answers_from_before_the_shared_data_came_do_not_bring_them_again(together: int) -> None:
    far = InTurn()

    def work_a_little() -> bool:
        far.work(together)
        return False

    with Sweep(operator.mul, 7, far) as sweep:
        assert dict(sweep.run(TASKS, stop=work_a_little)) == EXPECTED
    assert far.sent == 1


GATE = threading.Event()


def first_alone(shared: int, task: int) -> int:
    """Return the product; all but the first wait for the gate."""
    if task:
        GATE.wait()
    return shared * task


def test_what_a_pool_drops_that_is_shut_down_meanwhile_is_done_here() -> None:
    GATE.clear()
    with ThreadPoolExecutor(1) as pool, Sweep(first_alone, 7, pool) as sweep:
        results = {}
        for i, result in sweep.run(TASKS):
            results[i] = result
            pool.shutdown(wait=False, cancel_futures=True)
            GATE.set()
    assert results == EXPECTED
    assert len(sweep.notes) == 1


@pytest.mark.parametrize("error", [BrokenExecutor, RuntimeError, OSError])
@pytest.mark.parametrize("breaks", ["submit", "result"])
@pytest.mark.parametrize("first", [0, 2])
def test_what_an_executor_loses_is_done_here_and_said(error: type[Exception], breaks: str, first: int) -> None:
    with Sweep(operator.mul, 7, Faulty(breaks, first, error), chunk=2) as sweep:
        results = list(sweep.run(TASKS))
    assert dict(results) == EXPECTED
    assert len(results) == len(TASKS)
    assert len(sweep.notes) == 1
    assert error.__name__ in sweep.notes[0]


def test_an_error_of_a_task_is_raised() -> None:
    with ThreadPoolExecutor(1) as executor:
        for where in (None, executor):
            with Sweep(operator.truediv, 1, where) as sweep, pytest.raises(ZeroDivisionError):
                dict(sweep.run([1, 0]))


def test_a_sweep_stops_when_told() -> None:
    with ThreadPoolExecutor(1) as executor:
        for where in (None, executor):
            with Sweep(operator.mul, 7, where) as sweep:
                results = sweep.run(TASKS, stop=lambda: True)
                assert list(results) == []


@pytest.mark.parametrize("number", range(1, 60, 3))
def test_ctrl_c_that_comes_as_a_lock_is_taken_leaves_none_taken(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The thread of a pool asks for it next, and a pool waits for its threads."""
    pool, told = ThreadPoolExecutor(1), pytest.raises(KeyboardInterrupt)
    with pool, interrupted_locks(number, monkeypatch), told, Sweep(operator.mul, 7, pool) as sweep:
        list(sweep.run(range(50)))


@pytest.mark.parametrize("workers", [0, -1, 1.5, True])
def test_a_pool_needs_workers(workers: Any) -> None:
    with pytest.raises(OptionError, match="workers must be a whole number of processes from 1 to"):
        processes(workers)


def no_semaphores(*given: Any) -> Any:
    raise OSError(30, "Read-only file system")


def test_where_processes_share_no_locks_a_pool_is_refused_with_what_it_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a container whose /dev/shm cannot be written."""
    monkeypatch.setattr("multiprocessing.synchronize._multiprocessing.SemLock", no_semaphores)
    with pytest.raises(OptionError, match=r"\(Read-only file system\); they need a writable /dev/shm"):
        processes(2)


def test_where_no_file_can_be_shared_the_work_is_done_here(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    with ThreadPoolExecutor(1) as pool, Sweep(operator.mul, 7, pool) as sweep:
        assert dict(sweep.run(TASKS)) == EXPECTED
    assert [note.split(";")[0] for note in sweep.notes] == [
        "a worker process or its executor failed (FileNotFoundError)"
    ]


LEAVING = """
import os, signal, sys, threading, time
from hpop.runtime.sweep import processes

def work(gate):
    while not os.path.exists(gate):
        time.sleep(0.01)

def interrupt(pool, gate):
    while not pool._shutdown_thread:
        time.sleep(0.01)
    for _ in range(2):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)  # lets the main thread take it
    open(gate, "w").close()

if __name__ == "__main__":
    with processes(2) as pool:
        jobs = [pool.submit(work, path) for path in (__file__, __file__, sys.argv[1], sys.argv[1])]
        jobs[0].result(), jobs[1].result()
        threading.Thread(target=interrupt, args=(pool, sys.argv[1])).start()
"""


def test_ctrl_c_while_workers_are_waited_for_ends_when_they_do(tmp_path: Path) -> None:
    """They end no sooner than Ctrl-C has come, twice."""
    script = tmp_path / "leaving.py"
    script.write_text(LEAVING)
    done = subprocess.run([sys.executable, script, tmp_path / "gate"], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert done.stderr.rstrip().endswith("KeyboardInterrupt")


# Workers that are killed, in the sweep of weights


def sphere(points: int) -> Graph:
    """Two nodes and arcs whose costs lie on a sphere, so that every one is an extreme supported point."""
    vectors = np.abs(np.random.default_rng(0).normal(size=(points, 3)))
    costs = 1e6 * (1 - vectors / np.linalg.norm(vectors, axis=1)[:, None])
    return Graph.from_arcs(2, [0] * points, [1] * points, np.rint(costs).astype(np.int64))


GRAPH = sphere(120)


def same(one: SupportedPaths, other: SupportedPaths) -> bool:
    paths = all(one.arcs(i).tolist() == other.arcs(i).tolist() for i in range(len(one)))
    weights = all((a == b).all() for a, b in zip(one.weights, other.weights, strict=True))
    return bool((one.costs == other.costs).all() and paths and weights and one.solved == other.solved)


def workers_of(executor: Executor) -> set[str]:
    """Process ids of those who do the jobs."""
    with Sweep(operator.call, os.readlink, executor) as sweep:
        return {result for _, result in sweep.run(["/proc/self"] * 20)}


class Killer:
    """A progress callback that kills a process after some weights."""

    def __init__(self, pid: Any, after: int) -> None:
        self.pid, self.after, self.killed = pid, after, 0

    def __call__(self, progress: Progress) -> None:
        if not self.killed and progress.stage == "weights" and progress.labels >= self.after:
            self.killed = self.pid()
            os.kill(self.killed, signal.SIGKILL)


def test_two_processes_find_the_same_and_one_that_is_killed_loses_nothing() -> None:
    serial = supported_paths(GRAPH, 0, 1)
    assert len(serial) == GRAPH.arcs
    with processes(2) as pool:
        there = supported_paths(GRAPH, 0, 1, executor=pool)
        assert same(serial, there)
        assert there.notes == ()
        assert str(os.getpid()) not in workers_of(pool)
        killer = Killer(lambda: next(iter(pool._processes)), after=100)
        there = supported_paths(GRAPH, 0, 1, executor=pool, progress=killer)
    assert killer.killed
    assert same(serial, there)
    assert any("BrokenProcessPool" in note for note in there.notes)


# A Dask scheduler on loopback


@contextmanager
def scheduled(processes: bool) -> Iterator[Any]:
    """Two workers and their scheduler, in processes of their own or in this one."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=processes, host="127.0.0.1", dashboard_address=":0", protocol="tcp"
    ) as local:
        yield local


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with scheduled(processes=False) as local:
        yield local


@pytest.mark.proof
def test_dask_workers_find_the_same(cluster: Any) -> None:
    graph = sphere(30)
    with dask(cluster.scheduler_address) as executor:
        assert same(supported_paths(graph, 0, 1), supported_paths(graph, 0, 1, executor=executor))


@pytest.mark.proof
def test_a_dask_worker_that_is_killed_loses_nothing() -> None:
    with scheduled(processes=True) as local:

        def worker() -> int:
            with local.get_client() as client:
                return int(min(client.run(os.getpid).values()))

        killer = Killer(worker, after=100)
        with dask(local.scheduler_address) as executor:
            assert str(os.getpid()) not in workers_of(executor)
            there = supported_paths(GRAPH, 0, 1, executor=executor, progress=killer)
    assert killer.killed
    assert same(supported_paths(GRAPH, 0, 1), there)


def test_results_that_a_scheduler_takes_with_it_are_made_here(cluster: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    async def gather(*_: Any, **__: Any) -> None:
        raise OSError("the connection broke while results were on their way")

    with dask(cluster.scheduler_address) as executor, Sweep(operator.mul, 7, executor) as sweep:
        monkeypatch.setattr("distributed.Client._gather", gather)
        assert dict(sweep.run(TASKS)) == EXPECTED
    assert len(sweep.notes) == 1


def test_a_scheduler_that_does_not_answer_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(clusters, "CONNECT", 0.2)
    with (
        pytest.raises(OptionError, match=r"no Dask scheduler answers at 'tcp://127.0.0.1:9'"),
        dask("tcp://127.0.0.1:9"),
    ):
        pass


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(OptionError, match=r"pip install 'hpop\[dask\]'"), dask("tcp://127.0.0.1:8786"):
        pass
