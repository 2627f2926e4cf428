"""Tables of what a body does: of any model, the same as its own poses and twists, and as pandas reads them back."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import hpop
from hpop.errors import OptionError, OutputError, UnknownName
from hpop.motions import States
from hpop.trajectories.trajectory import Trajectory
from tests import jointed
from tests.models.test_pan_tilt import HEAD

BASE = hpop.DifferentialDrive(camera_offset=(0.2, 0.0), camera_height=1.2)
POSES = [(2.0, 2.0, 0.0), (5.0, 2.0, 0.0), (5.0, 4.0, np.pi / 2)]
DRIVE = Trajectory.from_poses(BASE, POSES)
PANNED = Trajectory.through(
    HEAD,
    States(**dict(zip(HEAD.space.names, np.array([(*p, 0.3 * i, 0.1) for i, p in enumerate(POSES)]).T, strict=True))),
)
ARM = jointed.tour(jointed.Jointed())


def columns(table, names):
    return np.stack([table[name] for name in names])


@pytest.mark.parametrize(
    ("trajectory", "body"),
    [(DRIVE, "base"), (DRIVE, "camera"), (PANNED, "camera"), (PANNED, "base"), (ARM, "camera")],
    ids=["base", "camera on a base", "camera on a head", "base below a head", "camera of an arm"],
)
@pytest.mark.parametrize("executed", [True, False])
def test_a_table_is_what_the_model_says_at_these_times(trajectory, body, executed):
    run = trajectory.execution() if executed else trajectory
    table = trajectory.table(0.25, body=body, executed=executed)
    times = table["t"]
    assert (np.diff(times) > 0).all()
    assert np.diff(times).max() <= 0.25 + 1e-9
    assert (times[0], times[-1]) == (0.0, pytest.approx(run.duration, abs=1e-6))
    model, states, rates = run.model, run.at(times), run.rates(times)[0]
    pose, twist = model.pose(body, states), model.twist(body, states, rates)
    for name in ("x", "y", "z", "yaw", "pitch", "roll"):
        assert table[name].tolist() == np.broadcast_to(getattr(pose, name), times.shape).tolist()
    for names, vector in ((("vx", "vy", "vz"), twist.velocity), (("wx", "wy", "wz"), twist.rotation)):
        assert columns(table, names).tolist() == [np.broadcast_to(v, times.shape).tolist() for v in vector]
    assert {table.units[n] for n in ("vx", "vy", "vz")} == {"m/s"}
    assert [table.units[n] for n in ("t", "x", "yaw", "wz")] == ["s", "m", "rad", "rad/s"]


@pytest.mark.parametrize("trajectory", [DRIVE, PANNED, ARM], ids=["base", "head", "arm"])
def test_velocities_add_up_to_the_way(trajectory):
    """Independent of the model's twists: what is gone is the integral of how fast (trapezia of 2 ms)."""
    table = trajectory.table(0.002)
    gone = columns(table, "xyz") - columns(table, "xyz")[:, :1]
    speeds = columns(table, ("vx", "vy", "vz"))
    steps = np.diff(table["t"]) * (speeds[:, 1:] + speeds[:, :-1]) / 2
    assert np.abs(np.cumsum(steps, axis=1) - gone[:, 1:]).max() < 1e-3


def test_a_drive_of_3_m_begins_at_rest_and_is_planned_at_cruise_speed():
    straight = Trajectory.from_poses(BASE, [(2.0, 2.0, 0.0), (5.0, 2.0, 0.0)])  # 1 m/s, 1 m/s²
    real, planned = straight.table(1.0), straight.table(1.0, executed=False)
    assert real["t"].tolist() == pytest.approx([0, 1, 2, 3, 4])
    assert real["x"].tolist() == pytest.approx([2.2, 2.7, 3.7, 4.7, 5.2])  # the camera is 0.2 m ahead
    assert real["vx"].tolist() == pytest.approx([0, 1, 1, 1, 0])
    assert planned["x"].tolist() == pytest.approx([2.2, 3.2, 4.2, 5.2])
    assert planned["vx"].tolist() == pytest.approx([1, 1, 1, 1])
    assert real["z"].tolist() == [1.2] * 5


def test_states_are_a_table_too():
    table = PANNED.table(0.5, body=None)
    assert list(table.columns) == ["t", "x", "y", "yaw", "pan", "tilt", *(
        f"{name}_rate" for name in ("x", "y", "yaw", "pan", "tilt")
    )]  # fmt: skip
    assert (table["pan"][0], table["pan"][-1]) == (0.0, pytest.approx(0.6))
    assert table.units["pan_rate"] == "rad/s"


def test_one_who_stays_has_one_row():
    assert len(Trajectory.from_poses(BASE, POSES[:1]).table()) == 1


@pytest.mark.parametrize("trajectory", [DRIVE, ARM], ids=["base", "arm"])
def test_a_csv_file_reads_back_bit_for_bit(trajectory, tmp_path: Path):
    table = trajectory.table(0.1)
    table.to_csv(tmp_path / "camera.csv")
    import pandas  # takes a second, which each process of `make test` would spend

    read = pandas.read_csv(tmp_path / "camera.csv")
    assert read.columns.tolist()[:3] == ["t (s)", "x (m)", "y (m)"]
    assert read.to_numpy().T.tolist() == [column.tolist() for column in table.columns.values()]
    frame = table.to_dataframe()
    assert frame.to_numpy().tolist() == read.to_numpy().tolist()
    assert frame.attrs["units"]["wz"] == "rad/s"


def test_the_step_divides_the_time_without_a_double_end():
    straight = Trajectory.from_poses(BASE, [(0.0, 0.0, 0.0), (0.3, 0.0, 0.0)])
    assert straight.table(0.1, executed=False)["t"].tolist() == [0.0, 0.1, 0.2, 0.3]
    assert straight.table(0.2, executed=False)["t"].tolist() == pytest.approx([0.0, 0.2, 0.3])


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"step": 0}, "step must be a time in s"),
        ({"step": float("nan")}, "step must be a time in s"),
        ({"step": 1e-6}, "a table may have at most 1,000,000 rows"),
        ({"body": "cam"}, "Did you mean 'camera'?"),
        ({"body": "tool"}, "this robot has no body 'tool'. body must be one of base, camera, or None for its states"),
        ({"body": "plane"}, "body must be one of"),
        ({"body": ["base"]}, "body must be one of"),
    ],
)
def test_what_is_no_table_is_refused(asked, said):
    with pytest.raises(OptionError, match=re.escape(said)):
        DRIVE.table(**asked)


def test_a_column_or_a_file_that_cannot_be_is_refused(tmp_path: Path):
    table = DRIVE.table()
    with pytest.raises(UnknownName, match=r"no column 'yam'\. Did you mean 'yaw'\? Its columns: t, x"):
        table["yam"]
    with pytest.raises(
        OutputError, match=r"cannot write '.*camera\.csv': No such file or directory; choose another file"
    ):
        table.to_csv(tmp_path / "gone" / "camera.csv")
    with pytest.raises(OutputError, match="choose another file"):
        table.to_csv(tmp_path)
    with pytest.raises(OptionError, match="path must be the path of a file"):
        table.to_csv(None)


def test_a_notebook_sees_a_short_table():
    html = DRIVE.table()._repr_html_()
    assert html.count("<tr>") == 9
    assert "<th>vx (m/s)</th>" in html
