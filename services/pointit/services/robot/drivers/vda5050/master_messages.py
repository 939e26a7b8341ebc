"""Messages of a master control to an AGV by VDA 5050: orders and instant actions, as JSON."""

import datetime as dt
import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from pointit.schemas import NS_PER_S

Version = Literal["1.1.0", "2.0.0", "2.1.0"]
ActionType = Literal["cancelOrder", "stateRequest"]


@dataclass(frozen=True, slots=True)
class OrderNode:
    """A node of an order, released. Coordinates are those of the AGV's map, m."""

    sequence_id: int
    """Even. The edge to this node has the number before."""
    x: float
    y: float
    theta: float | None = None
    """Direction to face there, rad, or None for any."""

    @property
    def place(self) -> tuple[float, float]:
        """Return its coordinates, m."""
        return self.x, self.y


def node_id(order_id: str, sequence_id: int) -> str:
    """Return the id of a node, which no other order uses."""
    return f"{order_id}.{sequence_id}"


@dataclass(frozen=True, slots=True)
class Order:
    """An order, or an update, whose first node is the last one that was sent before."""

    order_id: str
    update_id: int
    nodes: tuple[OrderNode, ...]
    max_speed_mps: float | None = None


@dataclass(frozen=True, slots=True)
class InstantAction:
    """An action to be executed at once."""

    action_type: ActionType
    action_id: str


class MessageEncoder:
    """Makes messages for one AGV: topics, headers and JSON."""

    def __init__(
        self,
        interface: str,
        version: Version,
        manufacturer: str,
        serial_number: str,
        now_ns: Callable[[], int],
        *,
        prefix: str = "",
    ) -> None:
        """Write to the AGV `serial_number` of `manufacturer`.

        Args:
            interface: first level of the topics.
            version: of VDA 5050; its first digit is the second level.
            manufacturer: third level.
            serial_number: fourth level.
            now_ns: returns the time, Unix ns.
            prefix: levels in place of the first two, if the AGV has others.
        """
        self._version = version
        self._manufacturer = manufacturer
        self._serial_number = serial_number
        self._now_ns = now_ns
        self._sent = Counter[str]()
        first_levels = prefix.rstrip("/") or f"{interface}/v{version[0]}"
        self._prefix = f"{first_levels}/{manufacturer}/{serial_number}"

    def topic(self, name: str) -> str:
        """Return the MQTT topic for `name`, such as `order` or `state`."""
        return f"{self._prefix}/{name}"

    def order(self, order: Order, map_id: str) -> tuple[str, str]:
        """Return topic and payload of an order on the map `map_id`."""
        nodes = [_node(order, node, map_id) for node in order.nodes]
        edges = [_edge(order, start, end) for start, end in zip(order.nodes, order.nodes[1:], strict=False)]
        ids = {"orderId": order.order_id, "orderUpdateId": order.update_id}
        return self._message("order", {**ids, "nodes": nodes, "edges": edges})

    def actions(self, actions: Sequence[InstantAction]) -> tuple[str, str]:
        """Return topic and payload of instant actions."""
        listed = [
            {"actionType": each.action_type, "actionId": each.action_id, "blockingType": "NONE"}
            for each in actions
        ]
        body: dict[str, Any] = {"instantActions": listed}
        if self._version[0] != "1":  # renamed in version 2, not in its first schemas: AGVs ignore the other
            body["actions"] = listed
        return self._message("instantActions", body)

    def _message(self, name: str, body: dict[str, Any]) -> tuple[str, str]:
        header = {
            "headerId": self._sent[name] % (1 << 32),
            "timestamp": iso_time(self._now_ns()),
            "version": self._version,
            "manufacturer": self._manufacturer,
            "serialNumber": self._serial_number,
        }
        self._sent[name] += 1
        return self.topic(name), json.dumps({**header, **body}, allow_nan=False)


def iso_time(stamp_ns: int) -> str:
    """Return a time as ISO 8601 in UTC with hundredths, as in `2017-04-15T11:40:03.12Z`."""
    seconds, rest_ns = divmod(stamp_ns, NS_PER_S)
    whole = dt.datetime.fromtimestamp(seconds, dt.UTC)
    return f"{whole:%Y-%m-%dT%H:%M:%S}.{rest_ns // 10_000_000:02d}Z"


def _node(order: Order, node: OrderNode, map_id: str) -> dict[str, Any]:
    position: dict[str, Any] = {"x": round(node.x, 4), "y": round(node.y, 4), "mapId": map_id}
    if node.theta is not None:
        position["theta"] = round(node.theta, 4)
    return {
        "nodeId": node_id(order.order_id, node.sequence_id),
        "sequenceId": node.sequence_id,
        "released": True,
        "nodePosition": position,
        "actions": [],
    }


def _edge(order: Order, start: OrderNode, end: OrderNode) -> dict[str, Any]:
    made: dict[str, Any] = {
        "edgeId": f"{order.order_id}.{end.sequence_id - 1}",
        "sequenceId": end.sequence_id - 1,
        "released": True,
        "startNodeId": node_id(order.order_id, start.sequence_id),
        "endNodeId": node_id(order.order_id, end.sequence_id),
        "actions": [],
    }
    if order.max_speed_mps is not None:
        made["maxSpeed"] = order.max_speed_mps
    return made
