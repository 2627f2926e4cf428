"""Compilation of kernels by numba, and their cache on disk. Import it on first use only: it takes half a second.

numba writes its cache beside the source, or into the user's cache folder (NUMBA_CACHE_DIR overrides both). If neither
can be written, numba refuses to decorate; if the disk is full, it fails. Here kernels are then compiled anew in each
process, with one warning.

Before numba loads its first kernel, it prepares to compile: it imports everything it can compile (a quarter of a
second), and scipy.linalg (another quarter) only to check whether matrix products can be compiled. Cached kernels need
only numba's runtime, so these imports wait until a kernel is compiled. The check for matrix products is skipped: no
kernel here uses them, and numba repeats the check where a product is compiled.

With NUMBA_DISABLE_JIT, as for coverage or a debugger, kernels run as plain Python, about a hundred times slower.

numba also imports the package coverage wherever it is installed, only to check whether it measures this process. If it
does, it is imported already; else the import is skipped.
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
    _log.setLevel(logging.WARNING)  # else a log of all levels gets a line for each compiled instruction

__all__ = ["compiling_seconds", "inlined", "kernel", "lean", "numba", "wide"]

LOCK = "hpop.lock"
_caching: Any = import_module("numba.core.caching")
_runtime: Any = import_module("numba.core.runtime")
_event: Any = import_module("numba.core.event")


class _Stopwatch(_event.Listener):  # type: ignore[misc]
    """Clock of compilation time; the time of a kernel includes that of the kernels that it calls."""

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

# Ctrl-C waits while LLVM works: in a callback it would be lost, and between two calls that pass memory on it would
# crash. No call of LLVM can be interrupted anyway; between calls, while types are inferred, Ctrl-C acts at once.
_library: Any = import_module("numba.core.codegen").CPUCodeLibrary
for _step in ("add_ir_module", "finalize"):
    setattr(_library, _step, interrupts_held()(getattr(_library, _step)))


def compiling_seconds() -> float:
    """Return the seconds that this process has spent on compiling kernels; no time limit covers them."""
    return _stopwatch.seconds


@contextmanager
def compiling_elsewhere() -> Iterator[None]:
    """Count the time in this block, a wait for another process that compiles, as compilation time."""
    _stopwatch.on_start(None)
    try:
        yield
    finally:
        _stopwatch.on_end(None)


@cache
def _import_compilable() -> None:
    """Import everything that numba can compile, except scipy.linalg."""
    with suppress(ImportError, AttributeError):  # another version of numba may differ: then it takes longer
        linalg: Any = __import__("numba.np.linalg", fromlist=["ensure_blas"])
        ensure_blas = linalg.ensure_blas
        linalg.ensure_blas = lambda: None
        try:
            import numba.np.arraymath  # noqa: F401
        finally:
            linalg.ensure_blas = ensure_blas


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function at its first call, and cache the result on disk where a folder can be written."""
    return _cached_dispatcher(function)


def lean(function: Callable[..., Any]) -> Any:
    """Compile a kernel that allocates no arrays, so that numba need not count references.

    By default numba counts references at each call of another kernel, with two atomic instructions per array: up to 40
    % of
    the time of a loop that calls helpers. (The option is numba's own for such functions, though undocumented.)
    """
    return _cached_dispatcher(function, _nrt=False)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a lean helper that becomes part of each kernel that calls it, for the innermost loops."""
    return _cached_dispatcher(function, _nrt=False, forceinline=True)


def wide(function: Callable[..., Any]) -> Any:
    """Compile a lean kernel with vectorization of equal operations on neighbouring numbers.

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
    before = getattr(numba.config, name)
    setattr(numba.config, name, value)
    try:
        yield
    finally:
        setattr(numba.config, name, before)


class _PlainKernel:
    """Kernel that runs as plain Python, with the attributes of a compiled one; used with NUMBA_DISABLE_JIT."""

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
    """Variants of an uncompiled kernel, which takes arguments of all types."""

    def __contains__(self, signature: Any) -> bool:
        return True


def _cached_dispatcher(function: Callable[..., Any], **options: Any) -> Any:
    if getattr(numba.config, "DISABLE_JIT"):  # noqa: B009  (set when numba is imported)
        return _PlainKernel(function)
    dispatcher = numba.njit(function, nogil=True, **options)
    try:
        dispatcher._cache = _DiskCache(function)
    except (RuntimeError, OSError):
        _import_compilable()
        _warn_once("no folder for it can be written")
    return dispatcher


class _DiskCache(_caching.FunctionCache):  # type: ignore[misc]
    """Cache of a kernel's variants on disk. If the disk fails, kernels are compiled again; results do not change."""

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
        """Remove an index that is damaged, or names types of modules of an earlier version of hpop."""
        try:
            self._cache_file._load_index()
        except OSError:
            raise
        except Exception:  # unpickling may raise anything
            Path(self._cache_file._index_path).unlink(missing_ok=True)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Let one process at a time add to a folder.

    numba numbers the variants of a kernel by those it finds. Two processes at once may give two variants one number,
    and then run one in place of the other.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / LOCK).open("w") as file:
        with suppress(ImportError, OSError):  # Windows; a file system without locks
            fcntl: Any = import_module("fcntl")
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


@cache
def _warn_once(reason: str) -> None:
    warnings.warn(
        f"compiled code cannot be kept ({reason}), so each process compiles it again, for ten seconds or more; set "
        "NUMBA_CACHE_DIR to a folder that you can write",
        HpopWarning,
        stacklevel=2,
    )


def can_be_cached(dispatcher: Any) -> bool:
    """Return whether a folder for compiled kernels can be written."""
    return isinstance(dispatcher._cache, _DiskCache)


def is_cached(dispatcher: Any) -> bool:
    """Return whether any variant of a kernel is in memory or on disk; types of arguments are not compared."""
    if dispatcher.overloads:
        return True
    try:
        return bool(dispatcher._cache._cache_file._load_index())
    except Exception:  # no cache file, or a damaged one
        return False
