"""Compilation of kernels (functions for numba), and their cache on disk.

Import this module on first use only, because importing numba takes half a second.

numba writes its cache beside the source, or into the user's cache folder (NUMBA_CACHE_DIR overrides both). If it can
write neither, or the disk is full, numba raises an error. Here, kernels are then compiled anew in each process, with
one warning.

Before numba loads its first kernel, it prepares to compile. It imports everything that it can compile (a quarter of a
second), and scipy.linalg (another quarter) only to check whether matrix products can be compiled. Cached kernels need
only numba's runtime, so here these imports wait until a kernel must be compiled. The check for matrix products is
skipped, because no kernel here uses them, and numba repeats the check when it compiles one.

With NUMBA_DISABLE_JIT, which coverage and debuggers need, kernels run as plain Python, about a hundred times slower.

numba also imports the package coverage if it is installed, only to check whether it measures this process. If coverage
does, it is imported already; otherwise the import is skipped.
"""

from __future__ import annotations

import logging
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, update_wrapper
from importlib import import_module
from pathlib import Path
from time import perf_counter
from typing import Any

from hpop.errors import HpopWarning
from hpop.runtime.interrupts import interrupts_held

_coverage = sys.modules.setdefault("coverage", None)  # type: ignore[arg-type]
try:
    import numba
finally:
    if _coverage is None:
        del sys.modules["coverage"]

if (_log := logging.getLogger("numba")).level == logging.NOTSET:
    _log.setLevel(logging.WARNING)  # otherwise a log of all levels gets a line for each compiled instruction

__all__ = ["compiling_seconds", "inlined", "kernel", "lean", "numba", "wide"]

LOCK = "hpop.lock"
_caching: Any = import_module("numba.core.caching")
_runtime: Any = import_module("numba.core.runtime")
_event: Any = import_module("numba.core.event")


class _Stopwatch(_event.Listener):  # type: ignore[misc]
    """Clock that adds up the time that numba spends on compiling; nested compilations count once."""

    def __init__(self) -> None:
        self.seconds = self.began = 0.0
        self.depth = 0

    def on_start(self, event: Any) -> None:
        self.began = self.began if self.depth else perf_counter()
        self.depth += 1

    def on_end(self, event: Any) -> None:
        self.depth -= 1
        self.seconds += 0.0 if self.depth else perf_counter() - self.began


_stopwatch = _Stopwatch()
_event.register("numba:compile", _stopwatch)

# Ctrl-C is delayed while LLVM works. In a callback of LLVM it would be lost, and between two calls that hand over
# memory it would cause a crash. No call of LLVM can be interrupted anyway. Between calls, while numba infers types,
# Ctrl-C acts at once.
_library: Any = import_module("numba.core.codegen").CPUCodeLibrary
for _step in ("add_ir_module", "finalize"):
    setattr(_library, _step, interrupts_held()(getattr(_library, _step)))


def compiling_seconds() -> float:
    """Return the time, s, that this process has spent on compiling kernels; it does not count for time limits."""
    return _stopwatch.seconds


@contextmanager
def compiling_elsewhere() -> Iterator[None]:
    """Count the time of a block as compilation time: in it, this process waits for another one that compiles."""
    _stopwatch.on_start(None)
    try:
        yield
    finally:
        _stopwatch.on_end(None)


@cache
def _import_compilable() -> None:
    """Import everything that numba can compile, except scipy.linalg."""
    with suppress(ImportError, AttributeError):  # in another version of numba, this may fail and only takes longer
        linalg: Any = __import__("numba.np.linalg", fromlist=["ensure_blas"])
        ensure_blas = linalg.ensure_blas
        linalg.ensure_blas = lambda: None
        try:
            import numba.np.arraymath  # noqa: F401
        finally:
            linalg.ensure_blas = ensure_blas


def kernel(function: Callable[..., Any]) -> Any:
    """Decorate a function so that numba compiles it at its first call and caches the result on disk, if possible."""
    return _cached_dispatcher(function)


def lean(function: Callable[..., Any]) -> Any:
    """Decorate a kernel that allocates no arrays, so that numba need not count references to arrays.

    By default, numba counts references at each call of another kernel, with two atomic instructions per array. That can
    take 40 % of the time of a loop that calls helpers. (The option that turns it off is numba's, but undocumented.)
    """
    return _cached_dispatcher(function, _nrt=False)


def inlined(function: Callable[..., Any]) -> Any:
    """Decorate a helper without array allocation (see :func:`lean`) that is inlined into each kernel that calls it.

    This is for innermost loops.
    """
    return _cached_dispatcher(function, _nrt=False, forceinline=True)


def wide(function: Callable[..., Any]) -> Any:
    """Decorate a kernel without array allocation (see :func:`lean`) so that LLVM vectorizes neighbouring operations.

    LLVM's pass for this (SLP) is off in numba by default, because it takes time and few kernels gain from it.
    """
    dispatcher = lean(function)
    if isinstance(dispatcher, _PlainKernel):
        return dispatcher
    compiled = dispatcher._compiler.compile

    def compile_wide(*arguments: Any) -> Any:
        with _config_set("SLP_VECTORIZE", 1):  # numba compiles one kernel at a time
            return compiled(*arguments)

    dispatcher._compiler.compile = compile_wide
    return dispatcher


@contextmanager
def _config_set(name: str, value: Any) -> Iterator[None]:
    """Change a setting of numba within a block."""
    before = getattr(numba.config, name)
    setattr(numba.config, name, value)
    try:
        yield
    finally:
        setattr(numba.config, name, before)


class _PlainKernel:
    """Kernel that runs as plain Python but has the attributes of a compiled one; used with NUMBA_DISABLE_JIT."""

    def __init__(self, function: Callable[..., Any]) -> None:
        update_wrapper(self, function)
        self.py_func = function
        self.overloads = _AnySignature()
        self._cache = None

    def __call__(self, *arguments: Any) -> Any:
        return self.py_func(*arguments)

    def compile(self, signature: Any) -> None:
        """Do nothing: there is nothing to compile."""


class _AnySignature:
    """Stand-in for the compiled variants of a kernel; contains all types of arguments."""

    def __contains__(self, signature: Any) -> bool:
        return True


def _cached_dispatcher(function: Callable[..., Any], **options: Any) -> Any:
    """Return a function as a kernel of numba with a cache on disk; ``options`` are those of ``numba.njit``."""
    if getattr(numba.config, "DISABLE_JIT"):  # noqa: B009  (set when numba is imported)
        return _PlainKernel(function)
    dispatcher = numba.njit(function, nogil=True, **options)
    try:
        dispatcher._cache = _DiskCache(function)
    except (RuntimeError, OSError):
        _import_compilable()
        _warn_once("no cache folder can be written")
    return dispatcher


class _DiskCache(_caching.FunctionCache):  # type: ignore[misc]
    """Cache of a kernel's compiled variants on disk; if the disk fails, kernels are compiled again."""

    def load_overload(self, signature: Any, context: Any) -> Any:
        try:
            with interrupts_held():
                _runtime.rtsys.initialize(context)
                loaded = self._load_overload(signature, context)
        except Exception:  # a damaged file may raise anything
            loaded = None
        if loaded is None:
            _import_compilable()
        return loaded

    def save_overload(self, signature: Any, data: Any) -> None:
        try:
            with _locked(Path(self.cache_path)), interrupts_held():
                self._remove_unreadable_index()
                super().save_overload(signature, data)
        except OSError as error:
            _warn_once(f"{self.cache_path}: {error.strerror or error}")

    def _remove_unreadable_index(self) -> None:
        """Remove the cache's index if it is damaged, or refers to modules of an earlier version of hpop."""
        try:
            self._cache_file._load_index()
        except OSError:
            raise
        except Exception:  # unpickling may raise anything
            Path(self._cache_file._index_path).unlink(missing_ok=True)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Lock a cache folder during a block, so that only one process at a time adds to it.

    numba numbers a kernel's variants, starting after those that it finds. Two processes at once may give two variants
    one number, and would then run one in place of the other.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / LOCK).open("w") as file:
        with suppress(ImportError, OSError):  # Windows; a file system without locks
            fcntl: Any = import_module("fcntl")
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


@cache
def _warn_once(reason: str) -> None:
    """Warn, once for each reason, that compiled code cannot be cached."""
    warnings.warn(
        f"compiled code cannot be cached ({reason}), so each process compiles it again, which takes ten seconds or "
        "more; set the environment variable NUMBA_CACHE_DIR to a folder that you can write",
        HpopWarning,
        stacklevel=2,
    )


def can_be_cached(dispatcher: Any) -> bool:
    """Return whether a kernel can be cached on disk."""
    return isinstance(dispatcher._cache, _DiskCache)


def is_cached(dispatcher: Any) -> bool:
    """Return whether at least one compiled variant of a kernel, of whichever types, is in memory or on disk."""
    if dispatcher.overloads:
        return True
    try:
        return bool(dispatcher._cache._cache_file._load_index())
    except Exception:  # no cache file, or a damaged one
        return False
