"""evo, which SLAM systems are evaluated with, opens what is written as TUM and EuRoC, and finds the front's lengths."""

from __future__ import annotations

import numpy as np
import pytest
from evo.core import metrics, sync
from evo.tools.file_interface import read_euroc_csv_trajectory, read_tum_trajectory_file

import hpop
from hpop.export import save, write
from tests.export.given import robots


@pytest.fixture(scope="module")
def front():
    problem = hpop.Problem(
        hpop.examples.museum().world,
        hpop.DifferentialDrive(),
        (2, 10, 0),
        (21, 10, 0),
        ["turns", "length"],
    )
    return problem.solve(step=2.0)


def test_lengths_are_the_costs_of_the_front_and_the_two_formats_agree(front, tmp_path):
    rows = [0, len(front) - 1]
    save(None, front, tmp_path, rows=rows, formats=["tum", "euroc"], planned=True)
    for row in rows:
        tum = read_tum_trajectory_file(str(tmp_path / f"row_{row}.tum"))
        euroc = read_euroc_csv_trajectory(str(tmp_path / f"row_{row}.euroc.csv"))
        assert tum.check()[0]
        assert euroc.check()[0]
        assert tum.path_length == pytest.approx(front[row].costs["length"], rel=1e-9)
        assert euroc.path_length == pytest.approx(front[row].costs["length"], rel=1e-9)
        error = metrics.APE(metrics.PoseRelation.full_transformation)
        error.process_data(sync.associate_trajectories(tum, euroc))
        assert len(error.error) == tum.num_poses
        assert error.get_statistic(metrics.StatisticsType.max) < 1e-6
        assert max(tum.speeds) <= front.trajectories[row].model.speed + 1e-6


def test_evo_sees_what_is_executed_speed_up_and_slow_down(tmp_path):
    goes = robots()["differential drive"]
    tum = read_tum_trajectory_file(str(write(goes, tmp_path / "any.tum", rate=100)))
    assert tum.timestamps[-1] == pytest.approx(goes.execution().duration)
    assert tum.speeds[0] < 0.01 > tum.speeds[-1]
    assert np.abs(np.diff(tum.speeds)).max() < 0.011 * goes.model.acceleration + 0.01
