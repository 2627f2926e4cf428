"""Every export format writes whole files that independent readers read back, the same bytes every time."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from hpop.base.registry import formats
from hpop.errors import OptionError
from hpop.export import Exported, Frames, save, write
from hpop.trajectories.poses import poses
from tests.export.given import ODD, front, problem, robots
from tests.export.readers import OF_JOINTS, READERS

FILES = sorted({*READERS} - {"bag"})  # a bag is the messages of mcap, and takes its time
ROUGH = {"glb": 1e-6, "nav2-yaml": 1e-9}  # of float32 and of nine digits, by the size of a number


WRITTEN = [*((name, False) for name in FILES), ("csv", True), ("glb", True)]


def latin(rows, columns, every):
    """All pairs, of which every third, say, is left to `make test`: some of each row and of each column."""
    return [
        pytest.param(row, *column, marks=() if (i + j) % every == 0 else pytest.mark.proof)
        for i, row in enumerate(rows)
        for j, column in enumerate(columns)
    ]


def content(name, trajectory, **options):
    return formats[name](Exported(trajectory, **options))


def test_each_format_has_a_reader_that_hpop_did_not_write():
    assert {*READERS, *OF_JOINTS} == set(formats)


@pytest.mark.parametrize("name", READERS)
def test_it_says_its_frame_handedness_units_order_and_time_base(name):
    told = formats[name]
    assert re.match(r"(right|left)-handed, x .*(y|z) up.*, c?m[;,]", told.axes)
    assert re.search(r"x, y, z, w|w, x, y, z|pitch", told.axes)
    assert re.search(r"in (s|s and ns|whole ns) from the start|no times", told.axes)
    said = " ".join(told.__doc__.split()).lower()
    assert "``mcap``" in said or re.search(r"(right|left)-handed.*(y|z) up", said)
    assert told.suffix.startswith((".", "_"))


@pytest.mark.parametrize(("robot", "name", "planned"), latin(robots(), WRITTEN, every=3))
def test_what_is_read_back_is_what_was_written(name, robot, planned, tmp_path):
    trajectory = robots()[robot]
    path = tmp_path / f"any{formats[name].suffix}"
    if name == "nav2-yaml" and "base" not in trajectory.model.provides:
        with pytest.raises(OptionError, match="needs a robot with a base, but this one has none; use mcap"):
            write(trajectory, path, planned=planned)
        assert not path.exists()
        return
    write(trajectory, path, rate=7, planned=planned)
    found = READERS[name](path)
    assert [one.name for one in tmp_path.iterdir()] == [path.name]
    if name == "nav2-yaml":  # tests/export/test_nav2.py says which poses
        return
    asked = poses(trajectory, rate=7, planned=planned)
    rough = ROUGH.get(name, 1e-12)
    np.testing.assert_allclose(found.times, asked.times, rtol=rough, atol=1e-9)
    np.testing.assert_allclose(found.positions, asked.positions, rtol=rough, atol=rough)
    pose = trajectory.model.pose("camera", asked.states)
    axes = [np.stack(np.broadcast_arrays(*axis, asked.times)[:3], 1) for axis in (pose.ahead, pose.left, pose.up)]
    np.testing.assert_allclose(found.rotations, np.stack(axes, axis=2), atol=max(rough, 1e-7))


def test_a_bag_has_the_messages_of_the_mcap_file_and_reads_back(tmp_path):
    trajectory = robots()["pan-tilt"]
    path = write(trajectory, tmp_path / "any_bag", rate=3)
    assert (path / "poses.mcap").read_bytes() == content("mcap", trajectory, rate=3)
    found, asked = READERS["bag"](path), READERS["csv"](write(trajectory, tmp_path / "any.csv", rate=3))
    for one, other in zip(found, asked, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


@pytest.mark.parametrize("name", FILES)
def test_the_same_trajectory_gives_the_same_bytes(name):
    trajectory = robots()["pan-tilt"]
    assert content(name, trajectory, rate=3) == content(name, trajectory, rate=3)


@pytest.mark.parametrize(("body", "name"), latin(["base", "tool"], [(name,) for name in FILES], every=2))
def test_other_bodies_than_the_camera_are_written_as_well(name, body, tmp_path):
    trajectory = robots()["mobile arm"]
    path = write(trajectory, tmp_path / f"any{formats[name].suffix}", body=body, rate=5)
    found = READERS[name](path)
    if name != "nav2-yaml":  # always the base's
        np.testing.assert_allclose(found.positions, poses(trajectory, rate=5, body=body).positions, atol=1e-6)


@pytest.mark.parametrize("name", READERS)
def test_a_trajectory_of_one_pose_is_one(name, tmp_path):
    found = READERS[name](write(robots()["stays"], tmp_path / f"any{formats[name].suffix}"))
    assert found.times.tolist() == [0.0]
    assert found.positions[0, :2].tolist() == pytest.approx([2.0, 2.0] if name == "nav2-yaml" else [1.8, 2.1])
    assert found.rotations[0, :, 0].tolist() == pytest.approx([-1.0, 0.0, 0.0], abs=1e-6)


def test_rows_with_odd_names_are_whole_in_every_format(tmp_path):
    """Names of criteria and certificates come from files: they are text, which ends no line, element or terminal."""
    written = save(problem(), front(), tmp_path / "out", rows=[ODD, 2], formats=list(READERS), rate=1)
    named = {path.name for path in written}
    assert named == {path.name for path in (tmp_path / "out").iterdir()}
    assert len(named) == len(written) == 2 * (len(READERS) + 1)
    assert all(re.fullmatch(r"(least_script_2J_Höhe_s_x_1_0|row_2)[._][a-z0-9.]+", name) for name in named)
    for name, read in READERS.items():
        assert len(read(tmp_path / "out" / f"row_2{formats[name].suffix}").positions) > 1
    for path in written:
        if path.suffix in (".csv", ".tum", ".yaml"):
            assert not re.search("[\x00-\x09\x0b-\x1f\x7f-\x9f\u202e]", path.read_text()), path
    told = json.loads((tmp_path / "out/row_2.about.json").read_text())
    assert told["certificate"] == ODD
    assert told["costs"] == front()[2].costs
    assert [each["file"] for each in told["files"]] == [f"row_2{formats[name].suffix}" for name in READERS]


@pytest.mark.parametrize("rate", [0.3, 7.0, 1e4])
@pytest.mark.parametrize("name", ["csv", "euroc", "glb", "mcap"])
def test_times_grow_at_any_rate(name, rate, tmp_path):
    """Also as float32 and as whole nanoseconds, and the end is the end."""
    trajectory = robots()["stays"].with_hold(at=0, seconds=3.0 if rate < 1e4 else 0.0301)
    found = READERS[name](write(trajectory, tmp_path / f"any{formats[name].suffix}", rate=rate))
    assert (np.diff(found.times) > 0.0).all()
    assert found.times[-1] == pytest.approx(trajectory.duration, rel=1e-6)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"world": ""}, "a frame must be a name without blanks"),
        ({"base": "base link"}, "got 'base link'"),
        ({"camera": "a\nb"}, "without blanks"),
        ({"world": "/map"}, r"must not begin with a slash \(tf2\), got '/map'"),
        ({"world": "base_link"}, "the frames of world, base and camera must have different names"),
        ({"world": 3}, "got 3"),
    ],
)
def test_names_of_frames_are_checked(given, said):
    with pytest.raises(OptionError, match=said):
        Frames(**given)
