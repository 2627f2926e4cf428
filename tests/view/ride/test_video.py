"""Videos all round: frames are what pictures of their times are, players know the projection, nothing half-written."""

import hashlib
import json
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest
import shapely
from PIL import Image

import hpop
from hpop.errors import OptionError, OutputError, QueryError
from hpop.runtime.limits import Progress
from hpop.view import render_360, save_frames, save_video
from hpop.view.ride.video import Clip
from hpop.world.content.content import Landmark, Person

FPS, WIDTH = 6, 256


@pytest.fixture(scope="module")
def problem() -> hpop.Problem:
    world = hpop.World.from_polygons(
        [shapely.box(0, 0, 8, 0.2), (shapely.box(3, 2, 4, 3), (0, 1.0))], extent=shapely.box(0, 0, 8, 6)
    ).with_content(people=[Person(5, 3, velocity=(0.3, 0))], landmarks=[Landmark(2, 0.3, facing=math.pi / 2)])
    model = hpop.DifferentialDrive(camera_height=1.2)
    return hpop.Problem(world, model, (1, 1, 0), (2.5, 1, 1), ["turns", "length"])


@pytest.fixture(scope="module")
def goes(problem: hpop.Problem) -> hpop.Trajectory:
    return hpop.Trajectory.from_poses(problem.model, [(1, 1, 0), (2.5, 1, 1)])


@pytest.fixture(scope="module")
def front(problem: hpop.Problem, goes: hpop.Trajectory) -> hpop.Front:
    other = hpop.Trajectory.from_poses(problem.model, [(1, 1, 0), (1.7, 1, 0.5), (2.5, 1, 1)])
    costs = [[1.0, 1.6], [2.0, 1.5]]
    return hpop.Front.of(costs, [goes, other], names=["turns", "length"], units=["1", "m"], certificate="made by hand")


@pytest.fixture(scope="module")
def video(problem: hpop.Problem, front: hpop.Front, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_video(problem, front, tmp_path_factory.mktemp("new") / "it.mp4", row=0, fps=FPS, width=WIDTH)


def probed(path: Path) -> dict:
    if not shutil.which("ffprobe"):
        pytest.skip("no ffprobe; install ffmpeg")
    asked = ["-v", "error", "-count_frames", "-show_streams", "-of", "json"]
    done = subprocess.run(["ffprobe", *asked, str(path)], capture_output=True, text=True, check=True)
    (stream,) = json.loads(done.stdout)["streams"]
    return stream


def test_a_player_knows_that_the_video_is_all_round(video, goes):
    stream = probed(video)
    (told,) = (data for data in stream["side_data_list"] if data["side_data_type"] == "Spherical Mapping")
    assert told["projection"] == "equirectangular"
    assert (told["yaw"], told["pitch"], told["roll"]) == (0, 0, 0)
    assert (stream["codec_name"], stream["width"], stream["height"]) == ("h264", WIDTH, WIDTH // 2)
    assert stream["r_frame_rate"] == f"{FPS}/1"
    assert int(stream["nb_read_frames"]) == math.floor(goes.execution().duration * FPS) + 1


def test_each_frame_is_the_picture_of_its_time(video, problem, goes):
    with av.open(str(video)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    for k in (0, 7, len(frames) - 1):
        drawn = render_360(problem, goes, k / FPS, width=WIDTH).astype(float)
        error = np.mean((frames[k] - drawn) ** 2)
        assert 10 * math.log10(255**2 / error) > 33
        others = [np.mean((other - drawn) ** 2) for other in frames[max(k - 3, 0) : k + 4]]
        assert error == min(others)


def test_frames_before_they_are_encoded_are_pictures_byte_by_byte_with_any_number_of_workers(problem, goes):
    clips = [Clip.of(problem, goes, fps=4, width=64, workers=workers) for workers in (1, 3)]
    one, three = (list(clip.frames()) for clip in clips)
    assert len(one) == len(three) == len(clips[0].times)
    for t, a, b in zip(clips[0].times, one, three, strict=True):
        assert a.tobytes() == b.tobytes() == render_360(problem, goes, t, width=64).tobytes()


def test_what_lies_beside_says_what_was_seen_and_when(video, front):
    told = json.loads(video.with_name("it.mp4.json").read_text())
    assert (told["projection"], told["row"], told["costs"]) == ("equirectangular", 0, {"turns": 1.0, "length": 1.6})
    assert told["frame_times"]["values"] == pytest.approx([k / FPS for k in range(len(told["frame_times"]["values"]))])
    assert told["camera_height"]["values"] == [1.2]
    assert told["front"]["trajectories"] == 2
    assert "3 m high" in told["scene_notes"][0]
    front.save(video.with_name("front.json"))
    saved = json.loads(video.with_name("front.json").read_text())["points"]["costs"]
    digest = hashlib.sha256(json.dumps(saved, separators=(",", ":")).encode()).hexdigest()
    assert told["front"]["sha256"] == digest


def test_frames_as_pictures_need_no_encoder(problem, goes, tmp_path):
    seen: list[Progress] = []
    folder = save_frames(problem, goes, tmp_path / "a" / "frames", fps=2, width=64, progress=seen.append)
    names = sorted(path.name for path in folder.iterdir())
    count = math.floor(goes.execution().duration * 2) + 1
    assert names == [*(f"frame_{k:05}.png" for k in range(count)), "frames.json"]
    with Image.open(folder / "frame_00003.png") as image:
        np.testing.assert_array_equal(np.asarray(image), render_360(problem, goes, 1.5, width=64))
    assert [progress.detail for progress in seen][-1] == f"frame {count} of {count}"
    with pytest.raises(
        OutputError, match=r"^expected a new or empty folder, but [^:]+ exists; remove it, or choose another$"
    ):
        save_frames(problem, goes, folder, fps=2, width=64)


@pytest.mark.parametrize("save", [save_video, save_frames])
def test_nothing_stays_of_what_is_interrupted(save, problem, goes, tmp_path):
    def interrupt(progress: Progress) -> None:
        if "frame 3 " in progress.detail:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        save(problem, goes, tmp_path / "new" / "it.mp4", fps=FPS, width=64, progress=interrupt)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("save", [save_video, save_frames])
def test_what_the_disk_cannot_hold_is_not_begun(save, problem, goes, tmp_path):
    stays = goes.with_hold(at=1, seconds=3600)
    with pytest.raises(OutputError, match=r"864,\d\d\d frames of 16384 x 8192 may take .* MB, but .* has room for"):
        save(problem, stays, tmp_path / "new" / "it.mp4", fps=240, width=16384)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(os.name != "posix", reason="limits of files")
@pytest.mark.proof
def test_a_disk_that_is_full_after_all_keeps_nothing(tmp_path):
    code = (
        "import resource, sys, hpop, hpop.examples\nfrom hpop.view import save_video\n"
        "problem = hpop.examples.museum()\n"
        "goes = hpop.Trajectory.from_poses(problem.model, [(2, 10, 0), (4, 10, 0)])\n"
        "save_video(problem, goes, 'before.mp4', width=256)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))\n"
        "save_video(problem, goes, 'it.mp4', width=256)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "OutputError" in done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["before.mp4", "before.mp4.json"]


def test_without_an_encoder_the_way_out_is_told(problem, goes, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)  # as where it is not installed
    with pytest.raises(OutputError, match=r"pip install 'hpop\[video\]', or write PNG frames"):
        save_video(problem, goes, tmp_path / "it.mp4")


def test_what_cannot_be_filmed_is_told(problem, front, goes, tmp_path):
    with pytest.raises(OptionError, match="no row 2: the front has rows 0 to 1"):
        save_video(problem, front, tmp_path / "it.mp4", row=2)
    with pytest.raises(OptionError, match="row chooses a trajectory of a front"):
        save_video(problem, goes, tmp_path / "it.mp4", row=1)
    with pytest.raises(OptionError, match=r"ends in \.mp4, got 'it.avi'"):
        save_video(problem, goes, tmp_path / "it.avi")
    with pytest.raises(OptionError, match="fps must be a number of frames a second from 1 to 240"):
        save_video(problem, goes, tmp_path / "it.mp4", fps=0)
    with pytest.raises(QueryError, match="expected a trajectory"):
        save_video(problem, "knee", tmp_path / "it.mp4")
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write"):
        save_video(problem, goes, tmp_path / "file" / "it.mp4", width=64)
