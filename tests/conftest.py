"""Fixtures of all tests: the folder of public data, the number of examples drawn, and a working Ctrl-C."""

from __future__ import annotations

import gc
import os
import re
import signal
import sys
from collections.abc import Callable, Generator, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from _pytest.doctest import DoctestModule
from hypothesis import HealthCheck, settings

from hpop.base.registry import criteria, formats, goals, models, planners, readers
from tests.hulls import Hull
from tests.warm import Warm

# Bytecode is kept, whatever the environment says: without it each process that tests start compiles all of hpop.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# Two processes run tests on two cores: threads of OpenBLAS would only wait for each other, at full load.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

collect_ignore = ["fuzz"]  # a program of its own, with modules of its own

# `make test` draws the same examples each time, `make proof` more of them, others each time (--hypothesis-profile).
# Neither asks how long anything takes by the clock: machines are busy.
UNHURRIED = {
    "deadline": None,
    "suppress_health_check": [HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
}
settings.register_profile("test", derandomize=True, max_examples=10, **UNHURRIED)
settings.register_profile("proof", max_examples=250, **UNHURRIED)
settings.load_profile("test")


def pytest_configure() -> None:
    """Let Ctrl-C interrupt also where a script runs the tests as a job: shells let jobs ignore it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give each process whole groups of files."""
    from xdist.scheduler import LoadFileScheduling  # here: tests run without xdist, too

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return group_of(nodeid.split("::")[0])

    return Scheduling(config, log)


@cache
def group_of(file: str) -> str:
    """Return the group of a file, all of which one process runs, so that what its tests use is loaded once.

    It is "warm" for the files that fork processes, else the folder; files of no folder stand alone.
    """
    path = Path(__file__).parents[1] / file
    if path.is_file() and re.search(r"\bwarm\.(run|start)\(", path.read_text()):
        return "warm"
    return file if path.parent == Path(__file__).parent else str(path.parent)


@pytest.fixture(scope="session")
def warm() -> Iterator[Warm]:
    """Real processes without seconds of imports for each (tests/warm.py)."""
    server = Warm()
    yield server
    server.close()


@pytest.fixture(scope="session")
def hull() -> Hull:
    """Convex hulls of integer vectors, decided in fractions (tests/hulls.py)."""
    return Hull()


@pytest.fixture(scope="session")
def shared_data() -> Callable[[str], Path]:
    """Give the folder of a public data set by name; skip the test where it is not there."""
    root = Path(os.environ.get("HPOP_DATA", Path(__file__).parents[2] / "shared" / "data"))

    def folder(name: str) -> Path:
        if not (root / name).is_dir():
            pytest.skip(f"no public data {name!r} in {root}; set HPOP_DATA")
        return root / name

    return folder


@pytest.fixture
def registered_as_before() -> Iterator[None]:
    """Remove everything that a test registers: other tests list the registries."""
    registries = (criteria, formats, goals, models, planners, readers)
    before = [dict(registry.own()) for registry in registries]
    yield
    for registry, own in zip(registries, before, strict=True):
        for name in registry.own():
            del registry._types[name]
        registry._types.update(own)


@pytest.hookimpl(wrapper=True)
def pytest_generate_tests(metafunc: pytest.Metafunc) -> Generator[None]:
    """Leave to `make test` the cases that `seeds` and `cases` say, the first few seeds for one; all in `make proof`.

    The others are marked `proof`; `make test` does not collect them, for half of all items would be made to be dropped.
    """
    if mark := metafunc.definition.get_closest_marker("seeds"):
        few, of = mark.args[0], mark.kwargs["of"]
        seeds = list(range(of) if isinstance(of, int) else of)
        more = [pytest.param(seed, marks=pytest.mark.proof) for seed in seeds[few:]]
        metafunc.parametrize("seed", [*seeds[:few], *more])
    yield
    small = [case for case in metafunc._calls if all(mark.name != "proof" for mark in case.marks)]
    one_by_one = any("::" in asked for asked in metafunc.config.args)
    if mark := metafunc.definition.get_closest_marker("cases"):
        if "but" in mark.kwargs:
            left = [case for case in small if case.id not in mark.kwargs["but"]]
        elif isinstance(mark.args[0], int):
            left = small[: mark.args[0]]
        else:
            left = [case for case in small if case.id in mark.args]
        if not left and not one_by_one:
            name = metafunc.definition.nodeid
            raise pytest.UsageError(f"{name}: no case is left to `make test` by {mark.args or mark.kwargs}")
        for case in small:
            if case not in left:
                case.marks.append(pytest.mark.proof.mark)
        small = left
    if small and not one_by_one and metafunc.config.option.markexpr == "not proof":
        metafunc._calls[:] = small


@pytest.hookimpl(wrapper=True)
def pytest_collect_file(file_path: Path) -> Generator[None, list[pytest.Collector], list[pytest.Collector]]:
    """Look for examples in docstrings only in modules that have one: pytest would look at all objects of each."""
    collectors = yield
    if file_path.suffix != ".py" or ">>>" in file_path.read_text():
        return collectors
    return [collector for collector in collectors if not isinstance(collector, DoctestModule)]


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Keep imported and collected objects out of garbage collection, which then runs seldom."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()
        gc.set_threshold(100_000)  # objects more than before; 700 by default
