"""Claims: a file that is not of the search is refused and stays as it is; its own is written whole or not at all."""

from __future__ import annotations

import errno
import json
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hpop.search.machinery.checkpoint as module
from hpop.errors import OptionError
from hpop.runtime.limits import Budget, Progress, Status
from hpop.search import Graph, pareto_paths, staircase
from hpop.search.machinery.checkpoint import SHARE, Checkpoint, CheckpointError, Keeper


def refused(graph: Graph, file: Path, match: str, *, source: int = 0, target: Any = 60, **options: Any) -> None:
    before = file.read_bytes() if os.path.isfile(file) else None
    seen: list[Progress] = []
    with pytest.raises(CheckpointError, match=match):
        pareto_paths(graph, source, target, checkpoint=file, progress=seen.append, **options)
    assert seen == []
    assert before is None or file.read_bytes() == before
    assert not list(Path(file).parent.glob(f".{Path(file).name}.*"))


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
    """Return the file with another header and the old checksum."""
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


def test_one_that_takes_the_costs_in_another_order_is_refused(interrupted, monkeypatch):
    """As of a version that breaks ties otherwise between the paths that are least in one cost."""
    graph, file = interrupted
    before = file.read_bytes()
    monkeypatch.setattr(staircase, "_by_spread", lambda *arguments, usual=staircase._by_spread: usual(*arguments)[::-1])
    with pytest.raises(
        CheckpointError, match=r"does not fit .*the saved search compares the costs in another order.*; remove it"
    ):
        pareto_paths(graph, 0, 60, checkpoint=file)
    assert file.read_bytes() == before


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
    refused(graph, file, "is neither, so it is not overwritten")


@pytest.mark.parametrize("header", [b"[" * 100_000, b"\xff\xfe", b"7", b"{}", b'{"format": 1}'])
def test_a_header_that_is_no_header_is_refused(interrupted, header):
    graph, file = interrupted
    file.write_bytes(module.MAGIC + len(header).to_bytes(module.LENGTH, "little") + header)
    refused(graph, file, "truncated or damaged")


def test_places_where_no_file_can_be_are_refused(interrupted, tmp_path):
    graph, file = interrupted
    refused(graph, tmp_path, "is a folder; give another path")
    refused(graph, tmp_path / "nowhere" / "search.ckpt", "cannot write a checkpoint to .*nowhere.*: No such file")
    refused(graph, file / "search.ckpt", "cannot write a checkpoint to .*: Not a directory")
    refused(graph, tmp_path / ("long" * 100), "cannot write a checkpoint to .*: File name too long")
    os.mkfifo(tmp_path / "pipe")
    refused(graph, tmp_path / "pipe", "is no ordinary file")
    with pytest.raises(CheckpointError, match="null byte"):
        pareto_paths(graph, 0, 60, checkpoint="a\0b")
    assert sorted(os.listdir(tmp_path)) == ["pipe", "search.ckpt"]


@pytest.mark.parametrize("path", [7, "", b"search.ckpt", True])
def test_what_is_no_path_is_refused(path, chain):
    with pytest.raises(OptionError, match="must be the path of a file"):
        pareto_paths(chain(2), 0, 1, checkpoint=path)


@pytest.mark.parametrize("every", [-1, float("nan"), float("inf"), "30", True])
def test_a_pause_that_is_no_time_is_refused(every):
    with pytest.raises(OptionError, match="seconds between two checkpoints"):
        Checkpoint("search.ckpt", every)


def test_a_link_leads_to_the_file_and_stays_a_link(tmp_path, chain):
    (tmp_path / "disk").mkdir()
    link, file = tmp_path / "search.ckpt", tmp_path / "disk" / "search.ckpt"
    link.symlink_to(file)
    pareto_paths(chain(60), 0, 60, checkpoint=link, budget=Budget(max_labels=2000))
    assert link.is_symlink()
    assert file.is_file()


# Writing


def test_a_search_that_is_complete_at_once_leaves_no_file(tmp_path, chain):
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
    exact = pareto_paths(graph, 0, 60)
    assert paths.costs.tolist() == exact.costs.tolist()
    assert paths.stats.labels_generated == exact.stats.labels_generated
    assert file.read_bytes() == before
    assert os.listdir(file.parent) == [file.name]


def test_a_file_that_has_meanwhile_become_that_of_another_search_is_left_to_it(tmp_path, chain):
    """Two runs with one file: when they began there was none, so neither was refused."""
    ours, theirs, file = chain(40), chain(30), tmp_path / "search.ckpt"

    def begin_another(progress: Progress) -> None:
        if progress.stage == "search" and not file.exists():
            assert pareto_paths(theirs, 0, 30, checkpoint=file, budget=few).status is Status.LABEL_LIMIT

    few = Budget(max_labels=300)
    with pytest.warns(RuntimeWarning, match="was overwritten by another search, so this one is not saved"):
        found = pareto_paths(ours, 0, 40, method="general", checkpoint=file, budget=few, progress=begin_another)
    assert found.status is Status.LABEL_LIMIT
    assert pareto_paths(theirs, 0, 30, checkpoint=file).costs.tolist() == pareto_paths(theirs, 0, 30).costs.tolist()
    refused(ours, file, "is of another problem", target=40)


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

    def save(self: Keeper) -> None:
        nonlocal now
        written.append(now)
        now += 7

    monkeypatch.setattr(Keeper, "save", save)
    Keeper(Checkpoint(tmp_path / "search.ckpt", every=20), "").run(Long(), "general", None)  # type: ignore[arg-type]
    assert written[0] == 20
    assert set(np.diff(written)) == {7 + 7 * SHARE}
