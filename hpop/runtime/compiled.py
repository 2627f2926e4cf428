"""How kernels are compiled, and where they are kept; numba comes from here. Imported on first use only: half a second.

numba looks for a folder beside the source, then in the user's cache (NUMBA_CACHE_DIR overrides both). Where none can be
written it refuses to decorate, and it fails where a disk is full; here kernels are then compiled anew in each process,
which is said once.

Before it loads its first kernel numba gets ready to compile: it imports all that it can compile, a quarter of a second,
and scipy.linalg, another one, only to learn whether matrix products can be compiled. What is compiled already needs
numba's runtime alone, so all this is left until a kernel is compiled; and then the question of matrix products, which
no kernel here takes, for hpop requires SciPy. numba asks again where a product is compiled.

Where NUMBA_DISABLE_JIT is set, as for coverage or a debugger, kernels run as plain Python, some hundred times slower.

numba also imports the package coverage wherever it is installed, only to learn whether it measures this process. If it
does, it has been imported before; else it is left out.
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
    _log.setLevel(
        logging.WARNING
    )  # else whoever listens to everything gets a line for each instruction that is compiled

__all__ = ["compiling_seconds", "inlined", "kernel", "lean", "numba", "wide"]

LOCK = "hpop.lock"
_caching: Any = import_module("numba.core.caching")
_runtime: Any = import_module("numba.core.runtime")
_event: Any = import_module("numba.core.event")


class _Stopwatch(_event.Listener):  # type: ignore[misc]
    """Adds up the time of compiling; a kernel that another one calls is compiled within it."""

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

# Ctrl-C waits while LLVM works: in a callback it would be lost, and between two calls that hand memory over be a crash.
# Each call lasts until LLVM has ended anyway; in between, while types are inferred, Ctrl-C is obeyed at once.
_library: Any = import_module("numba.core.codegen").CPUCodeLibrary
for _step in ("add_ir_module", "finalize"):
    setattr(_library, _step, interrupts_held()(getattr(_library, _step)))


def compiling_seconds() -> float:
    """Return seconds that this process has spent on compiling kernels: no time limit covers them."""
    return _stopwatch.seconds


@contextmanager
def compiling_elsewhere() -> Iterator[None]:
    """Count the wait for another process that compiles as compiling."""
    _stopwatch.on_start(None)
    try:
        yield
    finally:
        _stopwatch.on_end(None)


@cache
def _ready_to_compile() -> None:
    """Import what numba can compile, all but scipy.linalg."""
    with suppress(ImportError, AttributeError):  # another version of numba may look elsewhere: then it takes longer
        linalg: Any = __import__("numba.np.linalg", fromlist=["ensure_blas"])
        asked = linalg.ensure_blas
        linalg.ensure_blas = lambda: None
        try:
            import numba.np.arraymath  # noqa: F401
        finally:
            linalg.ensure_blas = asked


def kernel(function: Callable[..., Any]) -> Any:
    """Return compile on first call, keep the result on disk where a folder can be written."""
    return _compiled(function)


def lean(function: Callable[..., Any]) -> Any:
    """Return compile a kernel that allocates nothing, so that numba need not count references to its arrays.

    It else does so at each call of another kernel, with two atomic instructions an array: up to 40 % of the time of a
    loop that calls helpers. (The option is numba's own for such functions, though undocumented.)
    """
    return _compiled(function, _nrt=False)


def inlined(function: Callable[..., Any]) -> Any:
    """Return compile a lean helper that becomes part of each kernel that calls it, for the innermost loops."""
    return _compiled(function, _nrt=False, forceinline=True)


def wide(function: Callable[..., Any]) -> Any:
    """Return compile a lean kernel in which the same steps on neighbouring numbers become one on a vector.

    LLVM's pass for that is off in numba by default: it takes time, and few kernels gain anything.
    """
    made = lean(function)
    if isinstance(made, _Plain):
        return made
    compiled = made._compiler.compile

    def compile_wide(*arguments: Any) -> Any:
        with _config_set("SLP_VECTORIZE", 1):  # numba compiles one kernel at a time
            return compiled(*arguments)

    made._compiler.compile = compile_wide
    return made


@contextmanager
def _config_set(name: str, value: Any) -> Iterator[None]:
    before = getattr(numba.config, name)
    setattr(numba.config, name, value)
    try:
        yield
    finally:
        setattr(numba.config, name, before)


class _Plain:
    """A kernel that runs as plain Python, with what is asked of compiled ones: NUMBA_DISABLE_JIT is set."""

    def __init__(self, function: Callable[..., Any]) -> None:
        update_wrapper(self, function)
        self.py_func = function
        self.overloads = _Every()
        self._cache = None

    def __call__(self, *arguments: Any) -> Any:
        return self.py_func(*arguments)

    def compile(self, signature: Any) -> None:
        """Do nothing: there is nothing to compile."""


class _Every:
    """The variants of a kernel that needs none: it takes arguments of all types."""

    def __contains__(self, signature: Any) -> bool:
        return True


def _compiled(function: Callable[..., Any], **options: Any) -> Any:
    if getattr(numba.config, "DISABLE_JIT"):  # noqa: B009  (set when numba is imported)
        return _Plain(function)
    made = numba.njit(function, nogil=True, **options)
    try:
        made._cache = _Kept(function)
    except (RuntimeError, OSError):
        _ready_to_compile()
        _warn_once("no folder for them can be written")
    return made


class _Kept(_caching.FunctionCache):  # type: ignore[misc]
    """A kernel's variants on disk; a disk that fails costs the time to compile, never the answer."""

    def load_overload(self, signature: Any, context: Any) -> Any:
        try:
            with interrupts_held():
                _runtime.rtsys.initialize(context)
                kept = self._load_overload(signature, context)
        except Exception:  # whatever a damaged file makes of reading it
            kept = None
        if kept is None:
            _ready_to_compile()
        return kept

    def save_overload(self, signature: Any, data: Any) -> None:
        try:
            with _alone(Path(self.cache_path)), interrupts_held():
                self._remove_unreadable_index()
                super().save_overload(signature, data)
        except OSError as error:
            _warn_once(f"{self.cache_path}: {error.strerror or error}")

    def _remove_unreadable_index(self) -> None:
        """Remove an index that is damaged, or names types of modules that an earlier version of hpop had."""
        try:
            self._cache_file._load_index()
        except OSError:
            raise
        except Exception:  # unpickling may raise anything
            Path(self._cache_file._index_path).unlink(missing_ok=True)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Let one process at a time add to a folder.

    numba numbers the variants of a kernel by those it finds: two processes at once may give two the same number, and
    then one is run in the place of the other.
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
        f"compiled code cannot be kept ({reason}), so it is compiled anew each time, for some ten seconds or more; set "
        "NUMBA_CACHE_DIR to a folder that you can write",
        HpopWarning,
        stacklevel=2,
    )


def can_be_kept(made: Any) -> bool:
    """Return whether there is a folder for what is compiled."""
    return isinstance(made._cache, _Kept)


def is_kept(made: Any) -> bool:
    """Whether any variant of a kernel is in memory or on disk, as far as one can tell without types of arguments."""
    if made.overloads:
        return True
    try:
        return bool(made._cache._cache_file._load_index())
    except Exception:  # nothing is kept, or it is damaged
        return False
