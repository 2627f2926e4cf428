"""Clusters: workers of Dask or Ray as executors of ``concurrent.futures``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager
from importlib import import_module
from typing import Any, TypeVar

from hpop.errors import OptionError

T = TypeVar("T")

CONNECT = 10  # s, time to wait for a connection to a scheduler


class _Cluster(Executor):
    """Executor over the workers of a Dask client.

    With Dask's own executor, a job would never end if the scheduler dies while the job's result is being sent.
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    def submit(self, fn: Callable[..., T], /, *arguments: Any, **named: Any) -> Future[T]:
        remote = self._client.submit(fn, *arguments, **named, pure=False)
        local: Future[T] = Future()
        local.add_done_callback(lambda ended: remote.cancel() if ended.cancelled() else None)
        self._client.loop.add_callback(self._copy_outcome, remote, local)
        return local

    async def _has_scheduler(self) -> bool:
        """Return True if the scheduler answers. The client may notice later than its jobs that it does not."""
        import asyncio  # slow to import

        try:
            await asyncio.wait_for(self._client.scheduler.identity(), CONNECT)
        except Exception:  # errors of a lost connection have many types
            return False
        return True

    async def _copy_outcome(self, remote: Any, local: Future[Any]) -> None:
        """Wait for a Dask job, and copy its result or error to the future ``local``.

        Whatever error a lost scheduler causes, the job has then not failed but ended without a result: CancelledError.
        """
        try:
            result = await remote
        except Exception as error:
            is_lost = not await self._has_scheduler()
            if local.set_running_or_notify_cancel():
                local.set_exception(CancelledError() if is_lost else error)
        else:
            if local.set_running_or_notify_cancel():
                local.set_result(result)


@contextmanager
def dask(address: str) -> Iterator[Executor]:
    """Connect to a Dask scheduler, such as ``tcp://host:8786``, and yield an executor over its workers.

    hpop must be installed on the workers. Raises OptionError if the extra hpop[dask] is not installed, or no scheduler
    answers.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError as error:
        raise OptionError(
            f"a Dask cluster needs Dask, which cannot be imported ({error}); run pip install 'hpop[dask]', or use "
            "workers of this machine"
        ) from None
    try:
        client = distributed.Client(address, timeout=CONNECT)
    except (OSError, ValueError) as error:
        raise OptionError(
            f"no Dask scheduler answers at {address!r} ({error}); start one with `dask scheduler`, and give the "
            "address that it prints"
        ) from None
    with client:
        yield _Cluster(client)


class _RayCluster(Executor):
    """Executor over the workers of a Ray cluster; each job occupies one processor."""

    def __init__(self, library: Any) -> None:
        self._library = library

    def submit(self, fn: Callable[..., T], /, *arguments: Any, **named: Any) -> Future[T]:
        future: Future[T] = self._library.remote(fn).remote(*arguments, **named).future()
        return future


@contextmanager
def ray(address: str) -> Iterator[Executor]:
    """Connect to a Ray cluster, such as ``host:6379`` or ``auto``, and yield an executor over its workers.

    hpop must be installed on its machines. Raises OptionError if Ray is not installed, or no cluster answers.
    """
    try:
        library: Any = import_module("ray")
    except ImportError as error:
        raise OptionError(f"a Ray cluster needs Ray, which cannot be imported ({error}); run pip install ray") from None
    try:
        library.init(address=address, log_to_driver=False, logging_level="ERROR")
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise OptionError(
            f"no Ray cluster answers at {address!r} ({error}); start one with `ray start --head`, and give the address "
            "that it prints"
        ) from None
    try:
        yield _RayCluster(library)
    finally:
        library.shutdown()
