"""Runs targets on numbered inputs in processes that may die, and counts what becomes of each by kind.

An input is (target, seed, number): whoever knows these three makes it again. A target is forked from a process in which
everything is imported and compiled. It reports each input's outcome through a pipe; if it dies, by a signal of its own
or of a limit, the input it was at is the failure, and another process goes on with the next.
"""

from __future__ import annotations

import faulthandler
import os
import resource
import select
import shutil
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

PROCESSOR_SECONDS = 20  # of one input: none needs one
MEMORY = 2 * 1024**3  # bytes that inputs may add to what is imported
WAITS = 120  # s without an outcome, nor processor time: it waits for something
OK = {"accepted", "refused"}

Attempt = Callable[[np.random.Generator, Path], str]


class Wrong(Exception):
    """Finding of a target: a wrong answer, or a message that is unfit for users."""


@dataclass(frozen=True)
class Target:
    """Target of mutated inputs.

    attempt  makes an input from a generator, in a folder of its own, tries it, and says "accepted" or "refused";
             whatever else it raises is a failure
    shares   of the time of all targets
    seconds  of processor time that an input may take; None: PROCESSOR_SECONDS
    """

    name: str
    attempt: Attempt
    shares: int = 1
    seconds: float | None = None


@dataclass
class Tally:
    """Outcomes of a target's inputs by kind, and the first number of each kind of failure."""

    outcomes: Counter[str] = field(default_factory=Counter)
    first: dict[str, int] = field(default_factory=dict)

    def add(self, number: int, outcome: str) -> None:
        self.outcomes[outcome] += 1
        if outcome not in OK:
            self.first.setdefault(outcome, number)

    @property
    def inputs(self) -> int:
        return self.outcomes.total()

    @property
    def failures(self) -> int:
        return sum(count for kind, count in self.outcomes.items() if kind not in OK)


def generator(seed: int, target: Target, number: int) -> np.random.Generator:
    """Return the random generator of one input."""
    return np.random.default_rng([seed, *target.name.encode(), number])


def run(target: Target, seed: int, folder: Path, *, seconds: float, inputs: int | None, first: int = 0) -> Tally:
    """Try a target on inputs ``first``, first + 1, ... until the seconds are over or so many are tried."""
    tally, number, end = Tally(), first, time.monotonic() + seconds
    last = sys.maxsize if inputs is None else first + inputs
    while number < last and time.monotonic() < end:
        for outcome in _forked(target, seed, folder, number, last, end):
            tally.add(number, outcome)
            number += 1
    return tally


def outcome_of(target: Target, seed: int, folder: Path, number: int) -> str:
    """Try one input here, and say what became of it."""
    try:
        return target.attempt(generator(seed, target, number), folder)
    except MemoryError:
        return "out of memory"
    except Wrong as wrong:
        return str(wrong)
    except BaseException as error:  # whatever it is: none is meant to come out
        *_, place = traceback.extract_tb(error.__traceback__)
        return f"{type(error).__name__} at {Path(place.filename).name}:{place.lineno}"


def _forked(target: Target, seed: int, folder: Path, number: int, last: int, end: float) -> Iterator[str]:
    """Outcomes of inputs in a process of their own, until all are tried, time is over, or it died, which is one too."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        _serve(target, seed, folder, number, last, end, writer)
    os.close(writer)
    silent, rest = 0.0, b""
    while True:
        used = _processor_seconds(child)
        if select.select([reader], [], [], 5.0)[0]:
            silent, piece = 0.0, os.read(reader, 65536)
            if not piece:
                break
            *lines, rest = (rest + piece).split(b"\n")
            yield from (line.decode("utf-8", "replace") for line in lines)
            continue
        silent = silent + 5.0 if _processor_seconds(child) - used < 0.1 else 0.0
        if silent >= WAITS:
            os.kill(child, signal.SIGKILL)
    os.close(reader)
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        over = f"over {_seconds(target)} processor seconds"
        named = {signal.SIGPROF: over, signal.SIGKILL: "waits, or was killed"}
        yield named.get(number, f"dies of {signal.Signals(number).name}")


def _serve(target: Target, seed: int, folder: Path, number: int, last: int, end: float, writer: int) -> None:
    """Try inputs one after the other and write each outcome on a line; never returns."""
    try:
        faulthandler.disable()
        limit = _memory() + MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        nothing = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(nothing, stream)
        signal.signal(signal.SIGPROF, signal.SIG_DFL)  # the end also of what never returns to Python
        while number < last and time.monotonic() < end:
            place = folder / str(number)
            place.mkdir(parents=True)
            os.chdir(place)
            signal.setitimer(signal.ITIMER_PROF, _seconds(target))
            outcome = outcome_of(target, seed, place, number)
            signal.setitimer(signal.ITIMER_PROF, 0)
            os.chdir(folder)
            shutil.rmtree(place, ignore_errors=True)
            os.write(writer, (outcome.replace("\n", " ")[:200] + "\n").encode("utf-8", "replace"))
            number += 1
    finally:
        os._exit(0)


def _seconds(target: Target) -> float:
    """Processor time that an input of a target may take."""
    return PROCESSOR_SECONDS if target.seconds is None else target.seconds


def _memory() -> int:
    """Address space of this process, bytes."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def _processor_seconds(process: int) -> float:
    """Processor time of a process so far; 0 once it is gone."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
