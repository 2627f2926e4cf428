"""Claims: a search that is stopped anywhere goes on as if it had not been; a file that is not its own is refused."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hpop.planners.search.checkpoint as module
from hpop.errors import OptionError
from hpop.planners.search import Graph, ParetoPaths, capped_mean_paths, pareto_paths
from hpop.planners.search import slices as in_slices
from hpop.planners.search.checkpoint import SHARE, Checkpoint, CheckpointError, Keeper, state
from hpop.planners.search.staircase import Staircase
from hpop.planners.search.turn_bounds import LAYERS
from hpop.status import Budget, Progress, Status


def chain(steps: int, most: tuple[int, ...] = (9, 3, 9), aggregates: list[str] | None = None) -> Graph:
    """Three random choices a step."""
    rng = np.random.default_rng(5)
    tails = np.repeat(np.arange(steps), 3)
    costs = rng.integers(0, most, (3 * steps, len(most)))
    return Graph.from_arcs(steps + 1, tails, tails + 1, costs, aggregates=aggregates)


def widening(steps: int = 30, dear: int = 2**27) -> Graph:
    """The first cost avoids a dear way, so that numbers outgrow 32 bits, and much dearer ones a key."""
    tails = np.repeat(np.arange(steps), 2)
    return Graph.from_arcs(steps + 1, tails, tails + 1, np.tile([[1, 1, 0], [0, 0, dear]], (steps, 1)))


def same(a: ParetoPaths, b: ParetoPaths) -> None:
    """Vectors, paths and counts are the same."""
    assert a.costs.tolist() == b.costs.tolist()
    assert [a.arcs(i).tolist() for i in range(len(a))] == [b.arcs(i).tolist() for i in range(len(b))]
    counts = ("method", "order", "labels_generated", "labels_expanded")
    assert [getattr(a.stats, name) for name in counts] == [getattr(b.stats, name) for name in counts]
    assert (a.status, a.gap) == (b.status, b.gap)


def piecewise(search: Callable[..., ParetoPaths], file: Path, pieces: int) -> None:
    """Search in one go, and in pieces that Ctrl-C stops, each from the file of the one before: the result is one."""
    seen: list[Progress] = []
    exact = search(progress=seen.append)
    slices = max(2, sum(p.stage == "search" for p in seen) // pieces)
    times, paths = 0, replace(exact, status=Status.INTERRUPTED)
    while paths.status is Status.INTERRUPTED:
        times, left = times + 1, slices

        def stop(progress: Progress) -> None:
            nonlocal left
            left -= progress.stage == "search"
            if progress.stage == "search" and left < 0:
                raise KeyboardInterrupt

        paths = search(checkpoint=file, progress=stop)
    assert times > 2
    assert paths.status is Status.COMPLETE
    same(paths, exact)


@pytest.fixture
def short_slices(monkeypatch: pytest.MonkeyPatch) -> None:
    """Slices of a few labels, and no wait for the disk."""
    monkeypatch.setattr(in_slices, "WORK", 200)
    monkeypatch.setattr(os, "fsync", lambda file: None)


@pytest.fixture
def interrupted(tmp_path: Path) -> tuple[Graph, Path]:
    """A graph, and the checkpoint of a search in it that was stopped."""
    graph, file = chain(60), tmp_path / "search.ckpt"
    assert pareto_paths(graph, 0, 60, checkpoint=file, budget=Budget(max_labels=2000)).status is Status.LABEL_LIMIT
    return graph, file


# It goes on as if it had not been stopped


@pytest.mark.usefixtures("short_slices")
@pytest.mark.parametrize("pieces", [3, 12])
@pytest.mark.parametrize("method", ["auto", "staircase", "general"])
@pytest.mark.parametrize(
    "graph",
    [chain(20), chain(60, (9, 3)), chain(22, (30, 4, 30), ["max", "sum", "sum"]), widening(), widening(dear=2**50)],
    ids=["three costs", "two", "a maximum", "wider numbers", "wider keys"],
)
def test_stopped_again_and_again_it_ends_as_if_never_stopped(tmp_path, graph, method, pieces):
    def search(**options: Any) -> ParetoPaths:
        return pareto_paths(graph, 0, graph.nodes - 1, method=method, **options)

    piecewise(search, tmp_path / "search.ckpt", pieces)


@pytest.mark.usefixtures("short_slices")
def test_so_does_a_search_with_four_costs_that_takes_turns_at_once(tmp_path, lattice):
    full = lattice(1, 12)
    worst = np.random.default_rng(2).integers(0, 9, full.arcs)
    costs, hows = np.column_stack([full.costs, worst]), ["sum", "sum", "sum", "max"]
    graph = Graph.from_csr(full.indptr, full.heads, costs, aggregates=hows)

    def search(**options: Any) -> ParetoPaths:
        return pareto_paths(graph, 1, graph.nodes - 2, **options)

    assert search().stats.method == "general"
    piecewise(search, tmp_path / "search.ckpt", 5)


@pytest.mark.usefixtures("short_slices")
def test_so_does_a_search_that_looks_ahead(tmp_path, lattice, monkeypatch):
    monkeypatch.setattr("hpop.planners.search.staircase.LONG", 0.05)
    looked = []
    look = Staircase._look_ahead

    def count(self: Staircase, clock: in_slices.Clock) -> None:
        look(self, clock)
        looked.append(self.layers.shape)

    monkeypatch.setattr(Staircase, "_look_ahead", count)
    graph = lattice(1, 12)

    def search(**options: Any) -> ParetoPaths:
        return pareto_paths(graph, 0, graph.nodes - 1, method="staircase", **options)

    piecewise(search, tmp_path / "search.ckpt", 5)
    assert looked == [(graph.nodes, LAYERS)] * 2  # once in one go, once in all the pieces


@pytest.mark.usefixtures("short_slices")
@pytest.mark.parametrize("method", ["staircase", "general"])
def test_so_does_an_approximate_one(tmp_path, method):
    graph = chain(30)

    def search(**options: Any) -> ParetoPaths:
        return pareto_paths(graph, 0, 30, method=method, eps=0.05, tolerance=[1, 0, 2], **options)

    piecewise(search, tmp_path / "search.ckpt", 5)


@pytest.mark.usefixtures("short_slices")
def test_so_does_a_search_under_a_cap(tmp_path):
    rng = np.random.default_rng(2)
    tails, heads = rng.integers(0, 12, (2, 50))
    graph = Graph.from_arcs(12, tails, heads, rng.integers(1, 9, (50, 4)))

    def search(**options: Any) -> ParetoPaths:
        return capped_mean_paths(graph, 0, 11, integral=0, duration=1, cap=60, **options)

    piecewise(search, tmp_path / "search.ckpt", 5)


@pytest.mark.parametrize("method", ["staircase", "general"])
@pytest.mark.parametrize("budget", [Budget(max_labels=3000), Budget(max_memory=600_000), Budget(time_limit=1e-4)])
def test_higher_limits_let_a_stopped_search_go_on(tmp_path, method, budget):
    graph, file = chain(70), tmp_path / "search.ckpt"
    exact = pareto_paths(graph, 0, 70, method=method)
    part = pareto_paths(graph, 0, 70, method=method, checkpoint=file, budget=budget)
    assert not part.status.is_final
    same(pareto_paths(graph, 0, 70, method=method, checkpoint=file), exact)


def test_a_label_limit_counts_what_was_done_before(interrupted):
    graph, file = interrupted
    again = pareto_paths(graph, 0, 60, checkpoint=file, budget=Budget(max_labels=2500))
    assert again.status is Status.LABEL_LIMIT
    assert 2500 <= again.stats.labels_generated < 2600


def test_ctrl_c_while_arrays_grow_waits_until_they_fit_each_other(tmp_path, monkeypatch):
    graph, file = chain(70), tmp_path / "search.ckpt"
    exact = pareto_paths(graph, 0, 70, method="general")
    grow = in_slices.Search._grow_front

    def interrupt(self: in_slices.Search) -> None:
        signal.raise_signal(signal.SIGINT)
        grow(self)

    monkeypatch.setattr(in_slices.Search, "_grow_front", interrupt)
    assert pareto_paths(graph, 0, 70, method="general", checkpoint=file).status is Status.INTERRUPTED
    monkeypatch.undo()
    same(pareto_paths(graph, 0, 70, method="general", checkpoint=file), exact)


def test_one_in_which_keys_become_too_narrow_goes_on_in_the_general_search(tmp_path, monkeypatch):
    graph, file = chain(40), tmp_path / "search.ckpt"
    monkeypatch.setattr(in_slices, "WORK", 3000)
    from hpop.planners.search.staircase import TooWide

    class Narrow(Staircase):
        def advance(self, clock: in_slices.Clock, work: int) -> int:
            if self.counters[in_slices.N_EXPANDED] > 200:
                raise TooWide
            return super().advance(clock, work)

    monkeypatch.setattr("hpop.planners.search.staircase.Staircase", Narrow)
    exact = pareto_paths(graph, 0, 40, method="staircase")
    assert exact.stats.method == "general"
    seen: list[Progress] = []

    def stop(progress: Progress) -> None:
        seen.append(progress)
        began_anew = progress.labels < max(p.labels for p in seen)
        if began_anew and progress.labels > 1000:
            raise KeyboardInterrupt

    part = pareto_paths(graph, 0, 40, method="staircase", checkpoint=file, progress=stop)
    assert (part.status, part.stats.method) == (Status.INTERRUPTED, "general")
    same(pareto_paths(graph, 0, 40, method="staircase", checkpoint=file), exact)


KILLED = """
import sys
import numpy as np
from hpop.planners.search import Graph, pareto_paths
from hpop.planners.search.checkpoint import Checkpoint
rng = np.random.default_rng(5)
steps = 100
tails = np.repeat(np.arange(steps), 3)
graph = Graph.from_arcs(steps + 1, tails, tails + 1, rng.integers(0, (9, 3, 9), (3 * steps, 3)))
paths = pareto_paths(graph, 0, steps, method="general", checkpoint=Checkpoint(sys.argv[1], every=0.01))
"""


def test_it_survives_kill_9(tmp_path):
    graph, file = chain(100), tmp_path / "search.ckpt"
    exact = pareto_paths(graph, 0, 100, method="general")
    process = subprocess.Popen([sys.executable, "-c", KILLED, file])
    while not file.exists():
        assert process.poll() is None, "it was complete before it could be killed"
        time.sleep(0.001)
    process.kill()
    assert process.wait() == -signal.SIGKILL
    seen: list[Progress] = []
    paths = pareto_paths(graph, 0, 100, method="general", checkpoint=file, progress=seen.append)
    assert next(p.labels for p in seen if p.stage == "search") > 0
    same(paths, exact)
    assert os.listdir(tmp_path) == ["search.ckpt"]  # what it was writing is gone


# What is refused, before anything is searched; the file stays as it is, and nothing is left beside it


def refused(graph: Graph, file: Path, match: str, *, source: int = 0, target: Any = 60, **options: Any) -> None:
    before = file.read_bytes() if os.path.isfile(file) else None
    seen: list[Progress] = []
    with pytest.raises(CheckpointError, match=match):
        pareto_paths(graph, source, target, checkpoint=file, progress=seen.append, **options)
    assert seen == []
    assert before is None or file.read_bytes() == before
    assert not os.path.exists(f"{file}.part")


def test_the_checkpoint_of_another_question_is_refused(interrupted):
    graph, file = interrupted
    another = "is of another problem: .* Give another file, or remove this one"
    costs = graph.costs.copy()
    costs[7, 2] += 1
    refused(Graph.from_csr(graph.indptr, graph.heads, costs), file, another)
    refused(Graph.from_csr(graph.indptr, graph.heads, graph.costs, aggregates=["max", "sum", "sum"]), file, another)
    refused(graph, file, another, source=1)
    refused(graph, file, another, target=59)
    refused(graph, file, another, target=[59, 60])
    refused(graph, file, another, method="general")
    refused(graph, file, another, eps=0.01)
    refused(graph, file, another, tolerance=[0, 0, 1])
    assert pareto_paths(graph, 0, [60], checkpoint=file, eps=0, tolerance=[0, 0, 0]).status is Status.COMPLETE


def rewritten(file: Path, **changes: Any) -> bytes:
    """The file with another header, its checksum not made anew."""
    content = file.read_bytes()
    begin = len(module.MAGIC) + module.LENGTH
    length = int.from_bytes(content[len(module.MAGIC) : begin], "little")
    text = json.dumps(json.loads(content[begin : begin + length]) | changes).encode()
    return module.MAGIC + len(text).to_bytes(module.LENGTH, "little") + text + content[begin + length :]


@pytest.mark.parametrize("changes", [{"format": 99}, {"hpop": "99.0"}, {"format": "new"}])
def test_another_version_is_refused_by_name(interrupted, changes):
    graph, file = interrupted
    file.write_bytes(rewritten(file, **changes))
    (new,) = changes.values()
    refused(graph, file, f"is of hpop .*{new}.*; this is hpop {module.__version__}, format {module.FORMAT}")


def test_a_truncated_or_lengthened_file_is_refused(interrupted):
    graph, file = interrupted
    content = file.read_bytes()
    for size in (24, 30, 200, len(content) // 2, len(content) - 33, len(content) - 1):
        file.write_bytes(content[:size])
        refused(graph, file, "truncated or damaged; remove it")
    file.write_bytes(content + b"\0")
    refused(graph, file, "truncated or damaged")


def test_a_damaged_file_is_refused_wherever_it_is_damaged(interrupted):
    graph, file = interrupted
    content = file.read_bytes()
    for place in np.random.default_rng(0).integers(len(module.MAGIC), len(content), 60).tolist():
        file.write_bytes(content[:place] + bytes([content[place] ^ 4]) + content[place + 1 :])
        refused(graph, file, "damaged")


@pytest.mark.parametrize(
    "arrays",
    [
        [["counters", "<i8", [2**39]]],
        [["counters", "<i8", [2**39, 2**39]]],
        [["counters", "|O", [1]]],
        [["counters", "<i8", [-1]]],
        [["counters", "<i8"]],
        [["counters", "<i8", 7]],
        [["counters", ["<i8"], [1]]],
        [[]],
        7,
        {"counters": 1},
    ],
)
def test_a_header_that_makes_no_sense_is_refused_and_nothing_allocated_for_it(interrupted, arrays):
    graph, file = interrupted
    file.write_bytes(rewritten(file, arrays=arrays))
    refused(graph, file, "truncated or damaged")


@pytest.mark.parametrize("text", [b"", b"hpop", b"hpop checkpoint", b"notes of mine\n" * 50])
def test_a_file_that_is_no_checkpoint_is_not_overwritten(interrupted, text):
    graph, file = interrupted
    file.write_bytes(text)
    refused(graph, file, "is no checkpoint of hpop, so it is not overwritten")


@pytest.mark.parametrize("header", [b"[" * 100_000, b"\xff\xfe", b"7", b"{}", b'{"format": 1}'])
def test_a_header_that_is_no_header_is_refused(interrupted, header):
    graph, file = interrupted
    file.write_bytes(module.MAGIC + len(header).to_bytes(module.LENGTH, "little") + header)
    refused(graph, file, "truncated or damaged")


def test_places_where_no_file_can_be_are_refused(interrupted, tmp_path):
    graph, file = interrupted
    refused(graph, tmp_path, "is a folder; give the path of a file")
    refused(graph, tmp_path / "nowhere" / "search.ckpt", "cannot write a checkpoint to .*nowhere.*: No such file")
    refused(graph, file / "search.ckpt", "cannot write a checkpoint to .*: Not a directory")
    refused(graph, tmp_path / ("long" * 100), "cannot write a checkpoint to .*: File name too long")
    os.mkfifo(tmp_path / "pipe")
    refused(graph, tmp_path / "pipe", "is no ordinary file")
    with pytest.raises(CheckpointError, match="null byte"):
        pareto_paths(graph, 0, 60, checkpoint="a\0b")
    assert sorted(os.listdir(tmp_path)) == ["pipe", "search.ckpt"]


@pytest.mark.parametrize("path", [7, "", b"search.ckpt", True])
def test_what_is_no_path_is_refused(path):
    with pytest.raises(OptionError, match="must be the path of a file"):
        pareto_paths(chain(2), 0, 1, checkpoint=path)


@pytest.mark.parametrize("every", [-1, float("nan"), float("inf"), "30", True])
def test_a_pause_that_is_no_time_is_refused(every):
    with pytest.raises(OptionError, match="seconds between two checkpoints"):
        Checkpoint("search.ckpt", every)


def test_a_link_leads_to_the_file_and_stays_a_link(tmp_path):
    (tmp_path / "disk").mkdir()
    link, file = tmp_path / "search.ckpt", tmp_path / "disk" / "search.ckpt"
    link.symlink_to(file)
    pareto_paths(chain(60), 0, 60, checkpoint=link, budget=Budget(max_labels=2000))
    assert link.is_symlink()
    assert file.is_file()


# Writing


def test_a_search_that_is_complete_at_once_leaves_no_file(tmp_path):
    assert pareto_paths(chain(5), 0, 5, checkpoint=tmp_path / "search.ckpt").status is Status.COMPLETE
    assert os.listdir(tmp_path) == []


def test_a_full_disk_is_told_and_the_search_goes_on_with_the_last_checkpoint_whole(interrupted, monkeypatch):
    graph, file = interrupted
    before = file.read_bytes()

    def full(number: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.warns(RuntimeWarning, match="cannot write the checkpoint .*No space left on device"):
        paths = pareto_paths(graph, 0, 60, checkpoint=Checkpoint(file, every=0))
    same(paths, pareto_paths(graph, 0, 60))
    assert file.read_bytes() == before
    assert os.listdir(file.parent) == [file.name]


def test_ctrl_c_while_it_is_written_leaves_the_last_one_whole(interrupted, monkeypatch):
    graph, file = interrupted
    before = file.read_bytes()
    monkeypatch.setattr(os, "fsync", lambda number: signal.raise_signal(signal.SIGINT))
    paths = pareto_paths(graph, 0, 60, checkpoint=Checkpoint(file, every=0))
    assert paths.status is Status.INTERRUPTED
    assert file.read_bytes() == before
    assert os.listdir(file.parent) == [file.name]


def test_writing_takes_no_more_than_its_share_of_the_time(tmp_path, monkeypatch):
    """A clock that ticks a second a slice, and seven more for each checkpoint."""
    now, written = 0.0, []
    monkeypatch.setattr(module, "perf_counter", lambda: now)

    class Long:
        def run(self, clock: Any, keep: Callable[[], None]) -> Status:
            nonlocal now
            for _ in range(2000):
                now += 1
                keep()
            return Status.COMPLETE

    def save(self: Keeper, search: Any, method: str) -> None:
        nonlocal now
        written.append(now)
        now += 7

    monkeypatch.setattr(Keeper, "save", save)
    Keeper(Checkpoint(tmp_path / "search.ckpt", every=20), "").run(Long(), "general", None)  # type: ignore[arg-type]
    assert written[0] == 20
    assert set(np.diff(written)) == {7 + 7 * SHARE}


def test_a_search_that_keeps_what_no_checkpoint_holds_is_a_bug(lattice):
    class Listing:
        def __init__(self) -> None:
            self.labels = [1, 2]

    with pytest.raises(AssertionError, match="keeps labels as"):
        state(Listing())  # type: ignore[arg-type]
