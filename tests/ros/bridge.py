"""A bridge to ROS without ROS: a websocket server that speaks rosbridge's protocol, as its document says.

Written from ROSBRIDGE_PROTOCOL.md (RobotWebTools/rosbridge_suite, commit 01cc6a1); what the document leaves open is as
the bridge does it (rosbridge_library/capabilities/advertise_action.py, commit 09af24d, and action_result.py, 1101795):
it accepts goals by itself, makes their ids, checks what it is sent against the types of ROS and drops what does not fit
with no more than a line in its own log, throws the values of a result away that says ``"result": false``, and aborts
all goals of a client that goes.

Nothing of hpop is used here. Types are those of rosbags, and those of the action are read from its definition.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from threading import Condition, Thread
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

PATIENCE = 30.0  # s, for what does come; no test waits for what does not
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
TYPE = "nav2_msgs/action/ComputePathToPose"
RESULTS = {
    "humble": "nav_msgs/Path path\nbuiltin_interfaces/Duration planning_time\n",
    "iron": "nav_msgs/Path path\nbuiltin_interfaces/Duration planning_time\nuint16 error_code\n",
    "jazzy": "nav_msgs/Path path\nbuiltin_interfaces/Duration planning_time\nuint16 error_code\nstring error_msg\n",
}  # docs.ros.org, nav2_msgs/action/ComputePathToPose; NAME=value lines left out
NAVIGATION = {"NavigateToPose": "", "NavigateThroughPoses": "int16 number_of_poses_remaining\n"}
NAVIGATED = {
    "humble": "std_msgs/Empty result\n",
    "iron": "uint16 error_code\n",
    "jazzy": "uint16 error_code\nstring error_msg\n",
}  # results; nav2_msgs of ros-navigation/navigation2, branches of these names
FED_BACK = (
    "geometry_msgs/PoseStamped current_pose\nbuiltin_interfaces/Duration navigation_time\n"
    "builtin_interfaces/Duration estimated_time_remaining\nint16 number_of_recoveries\nfloat32 distance_remaining\n"
)
OTHERS = {
    "people_msgs/msg/Person": "string name\ngeometry_msgs/Point position\ngeometry_msgs/Point velocity\n"
    "float64 reliability\nstring[] tagnames\nstring[] tags\n",
    "people_msgs/msg/People": "std_msgs/Header header\npeople_msgs/Person[] people\n",
    "map_msgs/msg/OccupancyGridUpdate": "std_msgs/Header header\nint32 x\nint32 y\nuint32 width\nuint32 height\n"
    "int8[] data\n",
    "nav2_msgs/msg/CostmapFilterInfo": "std_msgs/Header header\nuint8 type\nstring filter_mask_topic\nfloat32 base\n"
    "float32 multiplier\n",
}
ARM_GOALS = {
    "moveit_msgs/msg/RobotTrajectory": "trajectory_msgs/JointTrajectory joint_trajectory\n"
    "trajectory_msgs/MultiDOFJointTrajectory multi_dof_joint_trajectory\n",
    "moveit_msgs/action/ExecuteTrajectory_Goal": "moveit_msgs/RobotTrajectory trajectory\nstring[] controller_names\n",
    "control_msgs/action/FollowJointTrajectory_Goal": "trajectory_msgs/JointTrajectory trajectory\n"
    "trajectory_msgs/MultiDOFJointTrajectory multi_dof_trajectory\nbuiltin_interfaces/Duration goal_time_tolerance\n",
}  # moveit_msgs of MoveIt 2; control_msgs without its lists of tolerances, which default to none
MUST = {
    "send_action_goal": {"action": str, "id": str, "action_type": str, "args": dict},
    "cancel_action_goal": {"action": str, "id": str},
    "advertise": {"topic": str, "type": str},
    "unadvertise": {"topic": str},
    "publish": {"topic": str, "msg": dict},
    "subscribe": {"topic": str},
    "unsubscribe": {"topic": str},
    "advertise_action": {"action": str, "type": str},
    "unadvertise_action": {"action": str},
    "action_feedback": {"action": str, "id": str, "values": dict},
    "action_result": {"action": str, "id": str, "values": dict, "status": int, "result": bool},
}  # what each op that a client sends must have


@dataclass(eq=False)
class Goal:
    """A goal that was sent, and what came back."""

    id: str
    client: Client
    feedback: int = 0
    fed_back: Any = None
    status: int | None = None
    result: Any = None


@dataclass(eq=False)
class Client:
    """One connection, and what it offers and listens to."""

    connection: Any
    actions: dict[str, str] = field(default_factory=dict)
    topics: dict[str, str] = field(default_factory=dict)
    heard: dict[str, dict[str, Any]] = field(default_factory=dict)
    goals: dict[str, Goal] = field(default_factory=dict)


class FakeBridge:
    """Listens on a port of this machine; ``clients`` are those that are connected, ``log`` is what it complains of."""

    def __init__(self, distribution: str = "jazzy", port: int = 0) -> None:
        self.store = get_typestore(Stores.ROS2_JAZZY)
        self.store.register(get_types_from_msg(RESULTS[distribution], f"{TYPE}_Result"))
        self.store.register(get_types_from_msg("bool unused\n", f"{TYPE}_Feedback"))
        for name, more in NAVIGATION.items():
            for part, text in (("Result", NAVIGATED[distribution]), ("Feedback", FED_BACK + more)):
                self.store.register(get_types_from_msg(text, f"nav2_msgs/action/{name}_{part}"))
        for name, text in OTHERS.items():
            self.store.register(get_types_from_msg(text, name))
        for name, text in ARM_GOALS.items():
            self.store.register(get_types_from_msg(text, name))
        self.changed = Condition()
        self.clients: list[Client] = []
        self.connections = 0
        self.sent: list[tuple[str, dict[str, Any]]] = []  # goals of clients, and their cancellations
        self.published: list[tuple[str, Any]] = []
        self.log: list[str] = []
        self._count = 0
        self._server = serve(self._handle, "127.0.0.1", port, max_size=10_000_000, compression=None)
        self.port = self._server.socket.getsockname()[1]
        self.url = f"ws://127.0.0.1:{self.port}"
        self._thread = Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._server.shutdown()
        self.drop()
        self._thread.join()

    # What a test does

    def until(self, what: Callable[[], Any]) -> Any:
        """Wait until something is so; what it is."""
        with self.changed:
            assert self.changed.wait_for(what, PATIENCE), f"it never came; the bridge's log: {self.log}"
            return what()

    def offered(self, action: str) -> Client:
        """Wait for a client that offers an action, and return the newest."""
        return self.until(lambda: next((one for one in reversed(self.clients) if action in one.actions), None))

    def send_goal(self, action: str, args: Any) -> Goal:
        client = self.offered(action)
        with self.changed:
            self._count += 1
            goal = Goal(f"action_goal:{action}:{self._count}", client)
            client.goals[goal.id] = goal
        told = {"op": "send_action_goal", "id": goal.id, "action": action, "action_type": client.actions[action]}
        client.connection.send(json.dumps({**told, "args": args, "feedback": True}))
        return goal

    def cancel(self, goal: Goal) -> None:
        action = goal.id.split(":")[1]
        goal.client.connection.send(json.dumps({"op": "cancel_action_goal", "id": goal.id, "action": action}))

    def ended(self, goal: Goal) -> Goal:
        self.until(lambda: goal.status is not None)
        return goal

    def tell(self, topic: str, message: Any) -> None:
        """Publish to all who listen."""
        for client in self.until(lambda: [one for one in self.clients if topic in one.heard]):
            client.connection.send(json.dumps({"op": "publish", "topic": topic, "msg": message}))

    def raw(self, data: str | bytes) -> None:
        for client in self.until(lambda: list(self.clients)):
            with suppress(ConnectionClosed):  # it may be refused while it is sent
                client.connection.send(data)

    def drop(self) -> None:
        """Break all connections, and wait until they are gone."""
        broken = list(self.clients)
        for client in broken:
            client.connection.close()
        self.until(lambda: not any(client in self.clients for client in broken))

    # What the bridge does

    def _handle(self, connection: Any) -> None:
        client = Client(connection)
        with self.changed:
            self.clients.append(client)
            self.connections += 1
            self.changed.notify_all()
        try:
            for data in connection:
                with self.changed:
                    try:
                        self._take(client, json.loads(data))
                    except (AssertionError, KeyError, TypeError, ValueError) as error:
                        self.log.append(f"{type(error).__name__}: {error} of {data[:300]!r}")
                    self.changed.notify_all()
        except ConnectionClosed:
            pass
        finally:
            with self.changed:
                self.clients.remove(client)
                for goal in client.goals.values():
                    if goal.status is None:
                        kind = client.actions.get(goal.id.split(":")[1], TYPE)
                        goal.status, goal.result = ABORTED, self.populated(f"{kind}_Result", {})
                self.changed.notify_all()

    def _take(self, client: Client, message: dict[str, Any]) -> None:
        op = message.pop("op")
        for name, kind in MUST[op].items():
            assert type(message[name]) is kind, f"{op} needs {name} of {kind}"
        if op == "advertise":
            assert message["type"] in self.store.fielddefs, message["type"]
            client.topics[message["topic"]] = message["type"]
        elif op == "unadvertise":
            del client.topics[message["topic"]]
        elif op == "publish":
            made = self.populated(client.topics[message["topic"]], message["msg"])
            self.published.append((message["topic"], made))
        elif op == "subscribe":
            assert message["type"] in self.store.fielddefs, message["type"]
            client.heard[message["topic"]] = message
        elif op == "unsubscribe":
            del client.heard[message["topic"]]
        elif op in ("send_action_goal", "cancel_action_goal"):
            if op == "send_action_goal":
                message["args"] = self.populated(f"{message['action_type']}_Goal", message["args"])
            self.sent.append((op, message))
        elif op == "advertise_action":
            assert f"{message['type']}_Result" in self.store.fielddefs, message["type"]
            client.actions[message["action"]] = message["type"]
        elif op == "unadvertise_action":
            del client.actions[message["action"]]
        else:
            self._of_goal(client, op, message)

    def _of_goal(self, client: Client, op: str, message: dict[str, Any]) -> None:
        assert message["action"] in client.actions, f"{message['action']} has not been advertised"
        goal = client.goals[message["id"]]
        assert goal.status is None, f"{op} for a goal that has ended"
        kind = client.actions[message["action"]]
        if op == "action_feedback":
            assert message["values"] == {} or kind != TYPE, "the feedback has no fields"
            goal.fed_back = self.populated(f"{kind}_Feedback", message["values"])
            goal.feedback += 1
        elif message["result"]:
            goal.result = self.populated(f"{kind}_Result", message["values"])
            goal.status = message["status"] if message["status"] in (SUCCEEDED, CANCELED) else ABORTED
        else:
            goal.status, goal.result = ABORTED, self.populated(f"{kind}_Result", {})

    def populated(self, kind: str, values: Any) -> Any:
        """Return a message of a type: missing fields get ROS's defaults, unknown fields and other types are refused."""
        assert isinstance(values, dict), f"{kind} of {values!r:.80}"
        fields = dict(self.store.fielddefs[kind][1])
        assert set(values) <= set(fields), f"{kind} has no field {sorted(set(values) - set(fields))}"
        made = {}
        for name, (code, of) in fields.items():
            if code.name == "NAME":
                made[name] = self.populated(of, values.get(name, {}))
            elif code.name == "SEQUENCE":
                code, inner = of[0]
                kinds = {"string": str, "float64": float}
                made[name] = [
                    self.populated(inner, one) if code.name == "NAME" else kinds[inner[0]](one)
                    for one in values.get(name, [])
                ]
            else:
                kinds = {"string": str, "bool": bool, "float64": float, "float32": float}
                wanted = kinds.get(of[0], int)
                value = values.get(name, wanted())
                assert type(value) is wanted or (wanted is float and type(value) is int), f"{kind}.{name}: {value!r}"
                made[name] = wanted(value)
        return self.store.types[kind](**made)


@contextmanager
def fake_bridge(distribution: str = "jazzy", port: int = 0) -> Iterator[FakeBridge]:
    bridge = FakeBridge(distribution, port)
    try:
        yield bridge
    finally:
        bridge.close()
