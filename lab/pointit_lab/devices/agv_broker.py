"""A fake MQTT broker at which one virtual AGV by VDA 5050 reports, and drives as ordered."""

import asyncio
import itertools
import json
import math
from typing import Any

from pointit_lab.devices.mqtt_broker import MqttBrokerDevice, Published

TICK_S = 0.05

SPEED_MPS = 1.0

MAX_START_M = 0.5
"""Maximum distance from the AGV to the first node of an order."""

TOPICS = "uagv/v2/acme/7"

HEADER = {"timestamp": "2026-01-01T00:00:00.00Z", "manufacturer": "acme", "serialNumber": "7"}


class AgvBrokerDevice(MqttBrokerDevice):
    """A broker with the AGV 7 of acme, which stands at the origin."""

    def __init__(self) -> None:
        super().__init__()
        self.agv = VirtualAgv()
        self._driving: asyncio.Task[None] | None = None

    async def plug(self) -> None:
        """Listen, and let the AGV drive."""
        await super().plug()
        self._driving = asyncio.create_task(self._drive())

    async def unplug(self) -> None:
        """Close all connections; the AGV halts."""
        if self._driving is not None:
            self._driving.cancel()
            await asyncio.wait({self._driving})
            self._driving = None
        await super().unplug()

    def take(self, published: Published) -> None:
        """Pass a message on to the AGV."""
        self.agv.receive(published.topic, published.payload)

    async def _drive(self) -> None:
        while True:
            self.agv.drive(SPEED_MPS * TICK_S)
            if self.agv.has_changed:
                await self.publish(f"{TOPICS}/state", self.agv.state())
            pose = self.agv.visualization()
            await self.publish(f"{TOPICS}/visualization", pose)
            await asyncio.sleep(TICK_S)


class VirtualAgv:
    """Obeys one master control, as an AGV that can stop between nodes."""

    def __init__(self, place: tuple[float, float] = (0.0, 0.0), *, version: str = "2.0.0") -> None:
        """Stand at `place`, m."""
        self.place = place
        self.base: list[dict[str, Any]] = []
        """Nodes that it has still to reach."""
        self.extra: dict[str, Any] = {}
        """Fields of its state that replace its own, such as `operatingMode`."""
        self.has_changed = False
        """True if it has to send its state."""
        self.farthest_base_m = 0.0
        """Greatest length of the way that was released at any time, m."""
        self._version = version
        self._sent = 0
        self._order: tuple[str, int] = ("", 0)
        self._last_node: tuple[str, int] = ("", 0)
        self._actions: list[dict[str, str]] = []
        self._errors: list[dict[str, Any]] = []

    def receive(self, topic: str, payload: str | bytes) -> None:
        """Handle a message of its master."""
        published = json.loads(payload)
        if topic.endswith("/instantActions"):
            field = "instantActions" if self._version[0] == "1" else "actions"
            for action in published[field]:
                self._act(action)
        elif topic.endswith("/order"):
            self._process_order(published)
        self.has_changed = True

    def drive(self, distance_m: float) -> None:
        """Drive along the nodes, `distance_m` at most."""
        while self.base and distance_m > 0.0:
            node = self.base[0]
            node_place = _place(node)
            away_m = math.dist(self.place, node_place)
            if away_m > distance_m:
                part = distance_m / away_m
                x_m, y_m = self.place
                node_x_m, node_y_m = node_place
                x_m += part * (node_x_m - x_m)
                y_m += part * (node_y_m - y_m)
                self.place = (x_m, y_m)
                return
            distance_m -= away_m
            self.place = node_place
            self._last_node = (node["nodeId"], node["sequenceId"])
            del self.base[0]
            self.has_changed = True

    def state(self) -> bytes:
        """Return its state."""
        self.has_changed = False
        order_id, update_id = self._order
        node_id, sequence_id = self._last_node
        node_states: list[dict[str, Any]] = []
        for node in self.base:
            node_state = {"nodeId": node["nodeId"], "sequenceId": node["sequenceId"], "released": True}
            node_states.append(node_state)
        state: dict[str, Any] = {
            "orderId": order_id,
            "orderUpdateId": update_id,
            "lastNodeId": node_id,
            "lastNodeSequenceId": sequence_id,
            "nodeStates": node_states,
            "edgeStates": [],
            "agvPosition": self._position(),
            "driving": bool(self.base),
            "actionStates": self._actions,
            "batteryState": {"batteryCharge": 80.0, "charging": False},
            "operatingMode": "AUTOMATIC",
            "errors": self._errors,
            "safetyState": {"eStop": "NONE", "fieldViolation": False},
        }
        # Fields of `extra` replace those above, so they come last.
        return self._message({**state, **self.extra})

    def visualization(self) -> bytes:
        """Return its pose."""
        return self._message({"agvPosition": self._position(), "velocity": self._velocity()})

    def connection(self, state: str) -> bytes:
        """Return a message that says `state`, such as ONLINE."""
        return self._message({"connectionState": state})

    def _process_order(self, order: dict[str, Any]) -> None:
        ids = (order["orderId"], order["orderUpdateId"])
        if ids == self._order:
            return
        first, *others = order["nodes"]
        is_update = ids[0] == self._order[0]

        # An order continues at the last node of the base, or of the order before. A new one begins where the
        # AGV stands.
        is_continued = is_update or bool(self.base)
        if is_continued:
            last_id, _ = self._last_node
            if self.base:
                last_id = self.base[-1]["nodeId"]
            is_wrong = first["nodeId"] != last_id
        else:
            is_wrong = math.dist(_place(first), self.place) > MAX_START_M
        if is_wrong:
            order_id, update_id = ids
            references = [
                {"referenceKey": "orderId", "referenceValue": order_id},
                {"referenceKey": "orderUpdateId", "referenceValue": str(update_id)},
            ]
            kind = "orderUpdateError" if is_update else "noRouteError"
            self._errors = [{"errorType": kind, "errorLevel": "WARNING", "errorReferences": references}]
            return
            return

        self._errors = []
        self._order = ids
        if not is_continued:
            self._last_node = (first["nodeId"], first["sequenceId"])
        self.base += others
        places = [self.place, *(_place(node) for node in self.base)]
        steps = itertools.pairwise(places)
        base_m = sum(math.dist(start, end) for start, end in steps)
        self.farthest_base_m = max(self.farthest_base_m, base_m)

    def _act(self, action: dict[str, Any]) -> None:
        if action["actionType"] == "cancelOrder":
            if not self.base:
                references = [{"referenceKey": "actionId", "referenceValue": action["actionId"]}]
                self._errors = [{"errorType": "noOrderToCancel", "errorReferences": references}]
                return
            self.base = []
        finished = {"actionId": action["actionId"], "actionStatus": "FINISHED"}
        self._actions = [*self._actions[-9:], finished]

    def _position(self) -> dict[str, Any]:
        x, y = self.place
        return {"x": x, "y": y, "theta": 0.0, "mapId": "hall", "positionInitialized": True}

    def _velocity(self) -> dict[str, float]:
        """Return its velocity in its own frame, which is the map's: it does not turn."""
        if not self.base:
            return {"vx": 0.0, "vy": 0.0, "omega": 0.0}
        node_x_m, node_y_m = _place(self.base[0])
        x_m = node_x_m - self.place[0]
        y_m = node_y_m - self.place[1]
        away_m = math.hypot(x_m, y_m) or 1.0  # at the node it does not move
        vx_mps = SPEED_MPS * x_m / away_m
        vy_mps = SPEED_MPS * y_m / away_m
        return {"vx": vx_mps, "vy": vy_mps, "omega": 0.0}

    def _message(self, body: dict[str, Any]) -> bytes:
        self._sent += 1
        head = {"headerId": self._sent, "version": self._version, **HEADER}
        return json.dumps({**head, **body}).encode()


def _place(node: dict[str, Any]) -> tuple[float, float]:
    position = node["nodePosition"]
    return position["x"], position["y"]
