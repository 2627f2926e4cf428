"""The connection: made again when it breaks, bounded in size and rate; messages that make no sense harm nothing."""

from __future__ import annotations

import json
import socket
from itertools import pairwise
from threading import Event, Thread

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.sync.server import serve

import hpop.ros.bridge
from hpop.errors import OptionError
from hpop.ros import Bridge, Interface, PathServer, pose_message
from hpop.ros.bridge import Pace
from hpop.ros.messages import pose_stamped
from hpop.ros.paths import MOST_POSES
from hpop.ros.protocol import MOST_BYTES, GoalStatus, MessageServer, encoded, result, values_of
from tests.ros.bridge import ABORTED, SUCCEEDED, fake_bridge
from tests.ros.conftest import DELAYS, running
from tests.ros.test_action_server import ACTION, POSE, asked

PATIENCE = 30.0  # s


# Again and again


def test_a_connection_that_breaks_is_made_again_and_its_goals_are_given_up(gate, bridge, said):
    with running(gate, bridge.url, said):
        for count in (1, 2):
            goal = bridge.send_goal(ACTION, asked())
            assert gate.entered.wait(PATIENCE)
            gate.entered.clear()
            bridge.drop()
            assert bridge.ended(goal).status == ABORTED  # by the bridge
            assert gate.left.wait(PATIENCE)
            gate.left.clear()
            bridge.until(lambda count=count: bridge.connections > count)
        gate.open.set()
        assert bridge.ended(bridge.send_goal(ACTION, asked())).status == SUCCEEDED
        assert bridge.log == []  # nothing is told of goals that are over


def test_where_the_robot_is_is_forgotten_with_the_connection(served):
    served.tell(POSE, pose_message(2, 3, 0))
    assert served.ended(served.send_goal(ACTION, asked(use_start=False))).status == SUCCEEDED
    served.drop()
    served.until(lambda: served.connections == 2)
    assert served.ended(served.send_goal(ACTION, asked(use_start=False))).status == ABORTED


def test_a_bridge_may_come_later_and_each_wait_is_twice_the_one_before(planning, said):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with running(planning, f"ws://127.0.0.1:{port}", said):
        while len(said) < 6:
            assert said.told.wait(PATIENCE)
            said.told.clear()
        waits = [float(line.split(" again in ")[1].split()[0]) for line in said[:6]]
        assert waits == [1e-3, 2e-3, 4e-3, 8e-3, 8e-3, 8e-3]
        assert all("refused" in line for line in said[:6])
        with fake_bridge(port=port) as bridge:
            assert bridge.ended(bridge.send_goal(ACTION, asked())).status == SUCCEEDED


def test_a_bridge_that_closes_at_once_is_tried_again_after_ever_longer_waits(planning, said):
    """Here by a bridge that refuses every client."""
    with serve(lambda connection: connection.close(), "127.0.0.1", 0) as listening:
        thread = Thread(target=listening.serve_forever)
        thread.start()
        try:
            server = PathServer(planning, say=said)
            bridge = Bridge(
                f"ws://127.0.0.1:{listening.socket.getsockname()[1]}", server, say=said, delays=(1e-3, 60.0)
            )
            tries = Thread(target=bridge.run)
            tries.start()
            again = " again in "
            while sum(again in line for line in said) < 5:
                assert said.told.wait(PATIENCE)
                said.told.clear()
            bridge.stop()
            tries.join()
            server.close()
        finally:
            listening.shutdown()
            thread.join()
    waits = [float(line.split(again)[1].split()[0]) for line in said if again in line]
    assert waits[:5] == [1e-3, 2e-3, 4e-3, 8e-3, 16e-3]


def test_when_it_is_stopped_it_takes_back_what_it_offered(planning, bridge, said):
    with running(planning, bridge.url, said):
        client = bridge.offered(ACTION)
    bridge.until(lambda: not bridge.clients)
    assert (client.actions, client.topics, client.heard) == ({}, {}, {})
    assert bridge.log == []


@pytest.mark.parametrize(
    ("status", "why"),
    [
        (b"404 Not Found", "HTTP 404"),
        (b"301 Moved\r\nLocation: http://[bad", "ValueError"),
        (b"301 Moved\r\nLocation: gopher://x", "InvalidURI"),
    ],
)
def test_what_is_no_bridge_is_told(planning, said, status, why):
    """A server of web pages, say: it answers, but not with a websocket; or it leads to where none can be."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]

        def answer() -> None:
            connection, _ = listening.accept()
            with connection:
                connection.recv(4096)
                connection.sendall(b"HTTP/1.1 " + status + b"\r\nContent-Length: 0\r\n\r\n")

        thread = Thread(target=answer)
        thread.start()
        with running(planning, f"ws://127.0.0.1:{port}", said):
            thread.join()
            assert said.told.wait(PATIENCE)
        assert why in said[0]


@pytest.mark.parametrize(
    "url",
    ["", "localhost:9090", "http://localhost", "ws://", "ws://a:b", "ws://a:0", "ws://a:99999", "ws://\x1b", None, 3],
)
def test_an_address_that_is_none_is_refused(url):
    with pytest.raises(OptionError, match="must be the address of a bridge, such as ws://localhost:9090, got"):
        Bridge(url, None)


# Bounds


def test_more_messages_a_second_than_are_taken_wait_for_the_next():
    now, waited = [100.0], []

    def wait(seconds: float) -> None:
        waited.append(seconds)
        now[0] += seconds

    pace, times = Pace(3, lambda: now[0], wait), []
    for step in [0.1] * 5 + [0.0] * 7 + [2.0]:
        now[0] += step
        pace.step()
        times.append(now[0])
    for first, fourth in zip(times, times[3:], strict=False):
        assert fourth - first >= 1.0 - 0.2 - 1e-9
    assert len(waited) == 3
    assert sum(later - sooner for sooner, later in pairwise(times)) == pytest.approx(times[-1] - times[0])
    assert times[-1] == pytest.approx(100.5 + 2.0 + sum(waited))


def test_a_message_that_is_too_large_ends_the_connection_and_no_more(served, said):
    served.raw("[" + "0," * MOST_BYTES)
    served.until(lambda: served.connections == 2 and len(served.clients) == 1)
    assert served.ended(served.send_goal(ACTION, asked())).status == SUCCEEDED
    assert any(line.startswith("no connection to ") for line in said)


def test_the_longest_path_is_one_that_a_bridge_takes():
    """10,000,000 bytes are its max_message_size, unless it is told otherwise."""
    known = Interface(frame_id="m" * 100)
    numbers = [-0.12345678901234567e-111, -1.2345678901234567e-05, 12345678.123456789]
    pose = pose_stamped(0, known.frame_id, numbers, [numbers[0]] * 4)
    values = values_of(known, {"header": pose["header"], "poses": [pose] * MOST_POSES}, 1e9)
    sent = encoded(result(known, "i" * 1000, GoalStatus.SUCCEEDED, values))
    assert 7_000_000 < len(sent.encode()) < 10_000_000


def test_a_bridge_that_reads_nothing_is_left(monkeypatch, said):
    """Its buffers are filled; a send that takes nothing any more fails, where it would wait for ever."""
    monkeypatch.setattr(hpop.ros.bridge, "SENDING", 0.05)
    over, calls = Event(), []

    class Talking(MessageServer):
        def connected(self, send) -> None:
            calls.append("connected")
            for _ in range(400):
                send("x" * 100_000)

        def received(self, data) -> None:
            raise AssertionError(data)

        def disconnected(self) -> None:
            calls.append("disconnected")

    with serve(lambda connection: over.wait(PATIENCE), "127.0.0.1", 0, max_queue=1, close_timeout=0.1) as deaf:
        Thread(target=deaf.serve_forever, daemon=True).start()
        made = Bridge(f"ws://127.0.0.1:{deaf.socket.getsockname()[1]}", Talking(say=said), say=said, delays=DELAYS)
        thread = Thread(target=made.run)
        thread.start()
        while not any("no connection" in line for line in said):
            assert said.told.wait(PATIENCE)
            said.told.clear()
        over.set()
        made.stop()
        thread.join()
    assert calls[:2] == ["connected", "disconnected"]


# Messages that make no sense

GOAL = '{"op": "send_action_goal", "action": "/hpop/compute_path_to_pose"'
HOSTILE = [
    *("", " ", "null", "3", "[]", "{}", '{"op": 3}', '{"op": null}', '{"op": "no such op"}', '{"op": NaN}'),
    *('{"op": "send_action_goal"}', GOAL + "}", GOAL + ', "id": {}}', GOAL + ', "id": ""}', GOAL + ', "id": true}'),
    *(
        GOAL + f', "id": "{"i" * 2000}"}}',
        GOAL.replace("hpop", "") + ', "id": "1"}',
        '{"op": "send_action_goal", "op": ""}',
    ),
    *('{"op": "send_action_goal", "action": [], "id": "1"}', '{"op": "cancel_action_goal"}'),
    '{"op": "cancel_action_goal", "action": "/hpop/compute_path_to_pose", "id": "none"}',
    *(
        '{"op": "publish"}',
        '{"op": "publish", "topic": "/amcl_pose"}',
        '{"op": "publish", "topic": "/other", "msg": {}}',
    ),
    '{"op": "publish", "topic": "/amcl_pose", "msg": []}',
    '{"op": "publish", "topic": "/amcl_pose", "msg": {"pose": {"pose": {"position": {"x": 1e999}}}}}',
    *('{"op": "fragment", "data": "{", "num": 0, "total": 9999999}', '{"op": "png", "data": "iVBORw0KGgo="}'),
    *("[" * 100_000, '{"a":' * 100_000, '{"op": ' + "9" * 100_000 + "}"),
    *('{"op": "\\ud800"}', '{"op": "\\u001b[2J\\u202e"}', b"\x00\x01", b"\xff" * 1000),
]


def test_hostile_messages_are_ignored_and_told_a_few_times(served, said):
    for _ in range(3):
        for data in HOSTILE:
            served.raw(data)
    assert served.ended(served.send_goal(ACTION, asked())).status == SUCCEEDED
    assert (served.connections, served.log) == (1, [])
    remarks = [line for line in said if line.startswith("ignored ")]
    assert 0 < len(remarks) == len(set(remarks)) <= 20
    assert max(map(len, said)) < 400
    assert not any(letter in "".join(said) for letter in "\x1b\u202e\ud800")
    assert "further invalid messages are not reported" in said


words = st.sampled_from(
    [
        "op",
        "id",
        "action",
        "args",
        "goal",
        "start",
        "pose",
        "position",
        "x",
        "planner_id",
        "use_start",
        "topic",
        "msg",
        "",
    ]
)
values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=4),
    max_leaves=10,
)
ops = st.sampled_from(["send_action_goal", "cancel_action_goal", "publish", "status", "action_result"])


@pytest.fixture(scope="module")
def alone(planning):
    """Return a server that is connected to a list."""
    sent, lines = [], []
    server = PathServer(planning, say=lines.append)
    server.connected(sent.append)
    yield server, sent
    server.close()


@given(st.dictionaries(words, values, max_size=5), ops, st.booleans(), st.booleans())
def test_any_message_is_taken_and_whatever_is_sent_is_json_of_the_protocol(alone, message, op, names, tells):
    server, sent = alone
    message |= {"op": op}
    if names:
        message |= {"action": ACTION, "id": "7", "topic": POSE}
    if tells and isinstance(message.get("msg"), dict):
        message["msg"] |= {"header": {"frame_id": "map"}}
    server.received(json.dumps(message))
    for one in map(json.loads, list(sent)):
        assert one["op"] in {
            "advertise", "subscribe", "advertise_action", "action_feedback", "action_result", "publish",
        }  # fmt: skip


@given(st.text(max_size=40) | st.binary(max_size=40))
def test_any_text_is_taken(alone, data):
    alone[0].received(data)
