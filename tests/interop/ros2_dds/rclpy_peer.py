"""A genuine ROS 2 node (rclpy), told by lines of JSON what to do.

Runs in an environment of its own; imports nothing of ours. Each line on standard input is answered by one on
standard output: `{"do": "advertise" | "say" | "listen" | "heard" | "serve" | "call" | "declare" | …}`.
"""

import functools
import importlib
import json
import sys
import threading
from typing import Any


def _of(module: str, name: str) -> Any:
    """Return `name` of `module`. Only this program's environment has it, so type checkers must not see it."""
    return getattr(importlib.import_module(module), name)


Context = _of("rclpy.context", "Context")
SingleThreadedExecutor = _of("rclpy.executors", "SingleThreadedExecutor")
Node = _of("rclpy.node", "Node")
QoSProfile = _of("rclpy.qos", "QoSProfile")
DurabilityPolicy = _of("rclpy.qos", "DurabilityPolicy")
ReliabilityPolicy = _of("rclpy.qos", "ReliabilityPolicy")

PATIENCE_S = 20.0


def class_of(name: str) -> Any:
    package, kind, short = name.split("/")
    return _of(f"{package}.{kind}", short)


def qos_of(order: dict[str, Any]) -> Any:
    return QoSProfile(
        depth=order.get("depth", 10),
        reliability=ReliabilityPolicy.RELIABLE
        if order.get("reliable", True)
        else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if order.get("latched") else DurabilityPolicy.VOLATILE,
    )


def plain(value: Any) -> Any:
    """Return a message in types that JSON can represent."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if hasattr(value, "tolist"):
        return value.tolist()
    return value


def filled(message: Any, fields: Any) -> Any:
    """Return `message` with these fields."""
    for name, value in fields.items():
        before = getattr(message, name)
        setattr(message, name, filled(before, value) if isinstance(value, dict) else value)
    return message


def _set(done: threading.Event, _future: Any) -> None:
    done.set()


class Peer:
    """One node."""

    def __init__(self, name: str, domain: int) -> None:
        self.context = Context()
        self.context.init([], domain_id=domain)
        self.node = Node(name, context=self.context, use_global_arguments=False)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.publishers: dict[str, Any] = {}
        self.heard_on: dict[str, list[Any]] = {}
        self.asked: list[Any] = []
        threading.Thread(target=self.executor.spin, daemon=True).start()

    def advertise(self, order: dict[str, Any]) -> None:
        self.publishers[order["topic"]] = self.node.create_publisher(
            class_of(order["type"]), order["topic"], qos_of(order)
        )

    def say(self, order: dict[str, Any]) -> None:
        publisher = self.publishers[order["topic"]]
        publisher.publish(filled(publisher.msg_type(), order["value"]))

    def matched(self, order: dict[str, Any]) -> Any:
        return self.publishers[order["topic"]].get_subscription_count()

    def listen(self, order: dict[str, Any]) -> None:
        heard = self.heard_on.setdefault(order["topic"], [])

        def take(message: Any) -> None:
            heard.append(plain(message))

        self.node.create_subscription(class_of(order["type"]), order["topic"], take, qos_of(order))

    def heard(self, order: dict[str, Any]) -> Any:
        return self.heard_on[order["topic"]]

    def serve(self, order: dict[str, Any]) -> None:
        def answer(request: Any, response: Any) -> Any:
            self.asked.append(plain(request))
            return filled(response, order["response"])

        self.node.create_service(class_of(order["type"]), order["service"], answer)

    def declare(self, order: dict[str, Any]) -> None:
        for name, value in order["parameters"].items():
            self.node.declare_parameter(name, value)

    def requests(self, _order: dict[str, Any]) -> Any:
        return self.asked

    def call(self, order: dict[str, Any]) -> Any:
        kind = class_of(order["type"])
        client = self.node.create_client(kind, order["service"])
        if not client.wait_for_service(PATIENCE_S):
            raise TimeoutError(order["service"])
        answers: list[Any] = []
        for request in order["requests"]:
            done = threading.Event()
            future = client.call_async(filled(kind.Request(), request))
            future.add_done_callback(functools.partial(_set, done))
            if not done.wait(PATIENCE_S):
                raise TimeoutError(order["service"])
            answers.append(plain(future.result()))
        return answers

    def graph(self, order: dict[str, Any]) -> Any:
        node = self.node
        name = order["node"]
        namespace, _, short = name.rpartition("/")
        found: dict[str, Any] = {"nodes": node.get_fully_qualified_node_names(), "ends": []}
        for kind, ask in (
            ("publisher", node.get_publishers_info_by_topic),
            ("subscriber", node.get_subscriptions_info_by_topic),
        ):
            for topic, _ in node.get_topic_names_and_types():
                for info in ask(topic):
                    if info.node_name == short and info.node_namespace == (namespace or "/"):
                        latched = info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
                        reliable = info.qos_profile.reliability == ReliabilityPolicy.RELIABLE
                        type_hash = str(info.topic_type_hash)
                        found["ends"].append([kind, topic, info.topic_type, type_hash, reliable, latched])
        return found

    def silence(self, order: dict[str, Any]) -> None:
        self.node.destroy_publisher(self.publishers.pop(order["topic"]))


def main() -> None:
    peer = Peer(sys.argv[1], int(sys.argv[2]))
    sys.stdout.write("{}\n")
    sys.stdout.flush()
    for line in sys.stdin:
        order = json.loads(line)
        try:
            answer = {"value": getattr(peer, order.pop("do"))(order)}
        except Exception as error:  # noqa: BLE001 - the caller gets the error
            answer = {"error": f"{type(error).__name__}: {error}"}
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
