"""A record tells the session again, also one that was cut by a crash."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from threading import Thread

import pytest

from hpop.cli.living import replay_of
from hpop.errors import OutputError
from hpop.live.record import Record, read_record, utc
from tests.live.conftest import ROOM, Page

SCENE = {"type": "scene", "title": "a room"}


def test_what_was_told_is_told_again_in_order_and_at_its_times(tmp_path: Path) -> None:
    record = Record(tmp_path / "a.jsonl", {"scene": SCENE})
    record.add(0.1, "told", {"message": {"type": "note", "words": "one"}})
    record.add(0.2, "stop", {"viewer": 1})
    record.add(0.3, "state", {"x": 1.0, "y": 2.0})
    record.add(0.5, "told", {"message": {"type": "arrived"}})
    record.close()
    with replay_of(tmp_path / "a.jsonl") as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        try:
            page = Page(server.address(drives=False), role="watch")
            began = time.monotonic()
            page.until("arrived")
            assert time.monotonic() - began > 0.3
            page.say("stop")
            assert page.until("refused")["words"] == "this page watches"
            page.close()
        finally:
            server.shutdown()
            thread.join()
    kinds = [message["type"] for message in page.told]
    assert kinds[:4] == ["scene", "note", "state", "arrived"]
    assert (page.told[2]["x"], page.told[0]["role"]) == (1.0, "watch")


def test_a_cut_last_line_is_left_out_and_other_files_are_refused(tmp_path: Path) -> None:
    record = Record(tmp_path / "a.jsonl", {"scene": SCENE})
    record.add(0.1, "go", {})
    record.close()
    whole = (tmp_path / "a.jsonl").read_bytes()
    (tmp_path / "cut.jsonl").write_bytes(whole + b'{"at": 17957')
    assert read_record(tmp_path / "cut.jsonl") == read_record(tmp_path / "a.jsonl")
    for wrong in (b"", b"{}", b"[1]\n", b'{"at": 1\n' + whole):
        (tmp_path / "wrong.jsonl").write_bytes(wrong)
        with pytest.raises(OutputError, match="live session"):
            read_record(tmp_path / "wrong.jsonl")
    with pytest.raises(OutputError, match="cannot be read"):
        read_record(tmp_path / "missing.jsonl")


@pytest.mark.proof
def test_a_killed_server_leaves_a_record_that_lacks_at_most_a_tenth_of_a_second(tmp_path: Path) -> None:
    (tmp_path / "room.yaml").write_text(ROOM)
    command = [sys.executable, "-P", "-m", "hpop", "live", "room.yaml", "--port", "0", "--out", "out"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        told = dict(process.stdout.readline().strip().split(": ", 1) for _ in range(3))
        page = Page(told["drive"])
        page.until("note", lambda message: message["words"] == "the map is prepared")
        page.say("destination", x=6.0, y=4.0)
        page.say("take", option=0)
        page.until("state", lambda state: state["moving"] and state["x"] > 1.2)
        page.silent()
        os.kill(process.pid, signal.SIGKILL)
        killed = utc()
        process.wait()
    events = read_record(tmp_path / told["record"])
    states = [event for event in events if event["event"] == "state"]
    assert killed - states[-1]["at"] < 200  # 100 ms, and what the machine needs to kill it
    assert {"destination", "take", "plan"} <= {event["event"] for event in events}
    seen = [message for message in page.told if message["type"] not in ("state", "scene")]
    told_again = [event["message"] for event in events if event["event"] == "told"]
    assert all(json.loads(json.dumps(message)) in told_again for message in seen if message["type"] != "note")
    last = time.monotonic() + 10
    while subprocess.run(["pgrep", "-f", f"hpop.cli.live_planner {tmp_path}"], check=False).returncode == 0:
        assert time.monotonic() < last, "the planner outlives the server"
        time.sleep(0.1)
