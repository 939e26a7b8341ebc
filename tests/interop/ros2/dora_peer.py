# (dora and pyarrow are in .venv-peers only)
"""An independent ROS 2 node, written in Rust by others (dora-rs), told by lines of JSON what to do.

Runs in .venv-peers; imports nothing of ours. Each line on standard input is answered by one on standard
output. On standard error it says which tokens it sees in the graph: `DORA_ROS2_ZENOH_TRACE=1`.
"""

import json
import queue
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import dora  # pyrefly: ignore[missing-import]  # see above
import pyarrow as pa

END_S = 20.0
LOOK_S = 0.005
SERVICE_DEPTH = 10
"""Queue depth of real nodes. dora 1.1.0 finds a server only if the text of its QoS is equal."""
ARROW = {"string": "string", "bool": "bool", "byte": "uint8", "float32": "float", "float64": "double"}


def qos(order: dict[str, Any]) -> Any:
    """Return the quality of service that was asked for."""
    latched = dora.Ros2Durability.TransientLocal if order.get("latched") else dora.Ros2Durability.Volatile
    depth = order.get("depth", SERVICE_DEPTH)
    return dora.Ros2QosPolicies(durability=latched, reliable=order.get("reliable", True), keep_last=depth)


def plain(value: Any) -> Any:
    """Return an Arrow value in types that JSON can represent."""
    if isinstance(value, bytes):
        return list(value)
    if isinstance(value, dict):
        return {name: plain(each) for name, each in value.items()}
    return [plain(each) for each in value] if isinstance(value, list) else value


def arrow(shape: Any) -> Any:
    """Return the Arrow type of what `ament.shape` describes."""
    if isinstance(shape, dict):
        return pa.struct([(name, arrow(each)) for name, each in shape.items()])
    if isinstance(shape, list):
        return pa.list_(arrow(shape[0]), *shape[1:])
    return pa.type_for_alias(ARROW.get(shape, shape))


def structure(value: Any, shape: Any) -> Any:
    """Return one value as dora takes it."""
    return pa.array([value], type=arrow(shape))


def forever(look: Callable[[], bool]) -> None:
    """Look again and again in a thread; dora wakes nobody."""

    def run() -> None:
        while True:
            if not look():
                time.sleep(LOOK_S)

    threading.Thread(target=run, daemon=True).start()


class Peer:
    """One node."""

    def __init__(self, name: str, configuration: str) -> None:
        transport = dora.Ros2Transport.zenoh("rep2016", configuration)
        self.context = dora.Ros2Context(transport=transport)  # its nodes do not outlive it
        self.node = self.context.new_node(name, "/", dora.Ros2NodeOptions(rosout=False))
        self.publishers: dict[str, Any] = {}
        self.subscriptions: list[tuple[Any, list[Any]]] = []
        self.heard: dict[str, list[Any]] = {}
        self.asked: dict[str, list[Any]] = {}
        self.acts: dict[str, Acts] = {}
        forever(self.look)

    def look(self) -> bool:
        """Take what has come. Return True if anything has."""
        found = False
        for subscription, heard in tuple(self.subscriptions):
            while (value := subscription.next()) is not None:
                heard.append(plain(value[0].as_py()))
                found = True
        return found

    def topic(self, order: dict[str, Any]) -> Any:
        return self.node.create_topic(order["topic"], order["type"].replace("/msg/", "/"), qos(order))

    def do_listen(self, order: dict[str, Any]) -> None:
        heard = self.heard.setdefault(order["topic"], [])
        self.subscriptions.append((self.node.create_subscription(self.topic(order), qos(order)), heard))

    def do_heard(self, order: dict[str, Any]) -> Any:
        heard = self.heard[order["topic"]]
        count = len(heard)
        taken = heard[:count]
        del heard[:count]
        return taken

    def do_advertise(self, order: dict[str, Any]) -> None:
        self.publishers[order["topic"]] = self.node.create_publisher(self.topic(order), qos(order))

    def do_say(self, order: dict[str, Any]) -> None:
        self.publishers[order["topic"]].publish(structure(order["value"], order["shape"]))

    def do_serve(self, order: dict[str, Any]) -> None:
        kind = order["type"].replace("/srv/", "/")
        server = self.node.create_service_server(order["service"], kind, qos(order))
        asked = self.asked.setdefault(order["service"], [])

        def answer() -> bool:
            request = server.take_request(timeout_s=0.1)
            if request is not None:
                number, value = request
                asked.append(plain(value[0].as_py()))
                server.send_response(number, structure(order["response"], order["shape"]))
            return True

        forever(answer)

    def do_asked(self, order: dict[str, Any]) -> Any:
        return self.asked[order["service"]]

    def do_call(self, order: dict[str, Any]) -> Any:
        kind = order["type"].replace("/srv/", "/")
        client = self.node.create_service_client(order["service"], kind, qos(order))
        return plain(client.call(structure(order["request"], order["shape"]), timeout_s=END_S)[0].as_py())

    def do_act(self, order: dict[str, Any]) -> None:
        """Serve an action: accept its goals, which end when told so, or when they are cancelled."""
        kind = order["type"].replace("/action/", "/")
        server = self.node.create_action_server(order["action"], kind, qos(order))
        acts = self.acts[order["action"]] = Acts(server, order)
        forever(acts.look)

    def do_goals(self, order: dict[str, Any]) -> Any:
        return self.acts[order["action"]].goals

    def do_feedback(self, order: dict[str, Any]) -> None:
        acts = self.acts[order["action"]]
        value = structure(order["value"], acts.order["feedback"])
        acts.todo.put(lambda: acts.server.send_feedback(order["goal"], value))

    def do_end(self, order: dict[str, Any]) -> None:
        acts = self.acts[order["action"]]
        acts.todo.put(lambda: acts.end(order["goal"], order["status"], order["value"]))


class Acts:
    """The goals of one action server, which dora lets only one thread use."""

    def __init__(self, server: Any, order: dict[str, Any]) -> None:
        self.server = server
        self.order = order
        self.goals: list[dict[str, Any]] = []
        self.todo: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()

    def look(self) -> bool:
        """Do what is to be done, and take what has come."""
        while not self.todo.empty():
            self.todo.get()()
        found = self.server.take_goal(timeout_s=0.02)
        if found is not None:
            goal, value = found
            self.goals.append({"goal": goal, "value": plain(value[0].as_py()), "cancelled": False})
        cancelled = self.server.take_cancel(timeout_s=0.02) or []
        for each in self.goals:
            if each["goal"] in cancelled:
                each["cancelled"] = True
                self.end(each["goal"], "canceled", self.order["empty"])
        return True

    def end(self, goal: str, status: str, value: Any) -> None:
        """End a goal; returns when the client has asked for the result."""
        self.server.send_result(goal, structure(value, self.order["result"]), status=status, timeout_s=END_S)


def main(name: str, configuration: str) -> None:
    """Obey until the input ends."""
    peer = Peer(name, configuration)
    print("{}", flush=True)  # noqa: T201 - the starting process waits for it
    for line in sys.stdin:
        order = json.loads(line)
        try:
            answer = {"value": getattr(peer, f"do_{order['do']}")(order)}
        except Exception as error:  # noqa: BLE001 - who asked is told
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), flush=True)  # noqa: T201 - the answer


if __name__ == "__main__":
    main(*sys.argv[1:])
