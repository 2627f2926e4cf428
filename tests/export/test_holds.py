"""A trajectory that holds, in every format: the hold begins and ends when it does, and the body stands between."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.base.registry import formats
from hpop.export import write
from hpop.trajectories.trajectory import Trajectory
from tests.export.given import DRIVE, POSES
from tests.export.readers import READERS

RATE = 40.0
TIMED = sorted({*READERS} - {"nav2-yaml", "bag"})
HELD = Trajectory.from_poses(DRIVE, POSES).with_hold(at=2, seconds=1.5).with_hold(at=1, seconds=2.25)


def stands(name: str, planned: bool, tmp_path) -> list[tuple[float, float]]:
    """From when to when the body stands for more than a second, read by others; nothing turns or moves meanwhile."""
    path = write(HELD, tmp_path / f"any{formats[name].suffix}", rate=RATE, planned=planned)
    read = READERS[name](path)
    still = np.abs(np.diff(read.positions, axis=0)).max(axis=1) < 1e-6
    still &= np.abs(np.diff(read.rotations, axis=0)).max(axis=(1, 2)) < 1e-6
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    found = [(read.times[begin], read.times[end]) for begin, end in edges.reshape(-1, 2)]
    return [(begin, end) for begin, end in found if end - begin > 1.0]


@pytest.mark.parametrize("planned", [True, False])
@pytest.mark.parametrize("name", TIMED)
def test_a_hold_begins_and_ends_when_it_does(name, planned, tmp_path):
    """Up to a sample at each end; under the planning law a turn stands for half a second before and after it."""
    run = HELD if planned else HELD.execution()
    holds = [i for i, kind in enumerate(run.kinds) if kind == "hold"]
    found = stands(name, planned, tmp_path)
    assert len(found) == len(holds) == 2
    before, after = (0.51, 0.51) if planned else (0.02, 0.02)  # ramps begin slowly
    for i, (begin, end) in zip(holds, found, strict=True):
        assert run.times[i] - before - 1.0 / RATE <= begin <= run.times[i] + 1.0 / RATE + 1e-6
        assert run.times[i + 1] - 1.0 / RATE - 1e-6 <= end <= run.times[i + 1] + after + 1.0 / RATE


def test_a_path_without_times_says_that_holds_are_lost():
    assert "no times" in formats["nav2-yaml"].axes
    assert "holds (waits) are lost" in formats["nav2-yaml"].__doc__
    assert set(READERS) - set(TIMED) == {"nav2-yaml", "bag"}  # a bag is the messages of mcap
