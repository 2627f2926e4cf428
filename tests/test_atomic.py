"""A file appears whole or not at all, and what a killed writer leaves is swept by the next."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading

import pytest

from hpop.base.files import check_replaceable, replacing

WRITES_FOR_EVER = """
import signal, sys
from hpop.base.files import replacing
with replacing(sys.argv[1]) as file:
    file.write(b"half")
    file.flush()
    print("writing", flush=True)
    signal.pause()
"""


@pytest.fixture
def path(tmp_path):
    (tmp_path / "front.json").write_bytes(b"old")
    return tmp_path / "front.json"


def write(path, data=b"new"):
    with replacing(path) as file:
        file.write(data)


def test_a_file_is_replaced(path):
    write(path)
    assert path.read_bytes() == b"new"
    assert os.listdir(path.parent) == ["front.json"]


def test_a_file_that_was_not_there_gets_the_usual_rights(path):
    path.unlink()
    write(path)
    (path.parent / "plain").touch()
    assert path.stat().st_mode == (path.parent / "plain").stat().st_mode


def test_a_link_stays_a_link_to_what_is_replaced(path):
    link = path.with_name("folder") / "link"
    link.parent.mkdir()
    link.symlink_to(path)
    write(link)
    assert (link.is_symlink(), path.read_bytes()) == (True, b"new")
    assert sorted(os.listdir(path.parent)) == ["folder", "front.json"]
    assert os.listdir(link.parent) == ["link"]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt(), ValueError("wrong")])
def test_where_writing_fails_the_old_file_stays_alone(path, error):
    def fail():
        with replacing(path) as file:
            file.write(b"half")
            raise error

    with pytest.raises(type(error)):
        fail()
    assert path.read_bytes() == b"old"
    assert os.listdir(path.parent) == ["front.json"]


def test_an_error_of_the_disk_names_the_file_that_was_asked_for(path):
    with pytest.raises(OSError, match=r"front\.json") as caught, replacing(path):
        raise OSError(28, "No space left on device", "elsewhere.tmp")
    assert ".tmp" not in str(caught.value)


def test_a_pipe_a_link_to_a_device_and_a_folder_keep_their_places(path):
    os.mkfifo(path.with_name("pipe"))
    path.with_name("link").symlink_to(os.devnull)
    for write_or_check in (write, check_replaceable):
        for place, said in (("pipe", "a pipe or a socket"), ("link", "found a device"), ("", "directory")):
            with pytest.raises(OSError, match=said):
                write_or_check(path.parent / place)
        with pytest.raises(IsADirectoryError):
            write_or_check("")
    assert sorted(os.listdir(path.parent)) == ["front.json", "link", "pipe"]
    assert path.with_name("pipe").is_fifo()
    assert path.with_name("link").is_symlink()


def test_what_a_killed_writer_leaves_is_swept_by_the_next(path):
    child = subprocess.Popen([sys.executable, "-c", WRITES_FOR_EVER, str(path)], stdout=subprocess.PIPE)
    assert child.stdout.readline() == b"writing\n"
    left = set(os.listdir(path.parent)) - {"front.json"}
    assert len(left) == 1
    write(path, b"beside")  # its writer lives: it stays
    assert left <= set(os.listdir(path.parent))
    child.send_signal(signal.SIGKILL)
    child.communicate()
    assert path.read_bytes() == b"beside"
    write(path)
    assert os.listdir(path.parent) == ["front.json"]


def test_files_of_other_names_are_not_swept(path):
    others = [".other.json.ab12.tmp", ".front.json.bak", "front.json.tmp", ".front.json.tmp"]
    for name in others:
        (path.parent / name).touch()
    (path.parent / ".front.json.folder.tmp").mkdir()
    write(path)
    assert sorted(os.listdir(path.parent)) == sorted(["front.json", ".front.json.folder.tmp", *others])


def test_writers_at_once_are_each_whole(path):
    begun = threading.Barrier(8)

    def writer(byte):
        try:
            for _ in range(20):
                begun.wait()
                write(path, bytes([byte]) * 10_000)
        except BaseException:
            begun.abort()
            raise

    threads = [threading.Thread(target=writer, args=(byte,)) for byte in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    data = path.read_bytes()
    assert len(data) == 10_000
    assert len(set(data)) == 1
    assert os.listdir(path.parent) == ["front.json"]
