"""Orders of one AGV by VDA 5050: the messages for a command, and their execution. Pure."""

import datetime as dt
import json
import math
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal

from pointit.schemas import NS_PER_S
from pointit.vda5050 import AgvState, blocked_by

Version = Literal["1.1.0", "2.0.0", "2.1.0"]
ActionType = Literal["cancelOrder", "stateRequest"]

Point = tuple[float, float]
Outcome = Literal["accepted", "done", "cancelled", "refused", "failed"]
Tell = Callable[[int, Outcome, str], None]
"""Called with the number of a command, what became of it, and the reason."""

SAME_M = 0.01
"""Distance below which two places are the same, m."""

PREFIX = "pointit-"
"""Beginning of the ids of our orders. One that nobody steers is cancelled, also that of an earlier run."""
OTHER_MASTER = "another master control has given the AGV an order"
RESEND_S = 1.0
"""Time without an answer after which a message is sent again, s. Orders are lost in radio networks."""
MAX_TRIES = 5
"""Number of times that an order is sent before it counts as failed."""
SAME_TARGET_M = 0.1
"""Change of a target that is not worth an order, m. A cursor trembles by some centimetres."""
NODES_AHEAD = 4
"""Maximum number of released nodes ahead of the AGV. Updates must arrive before the AGV brakes."""


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
        # For the header of each message
        self._version = version
        self._manufacturer = manufacturer
        self._serial_number = serial_number
        self._now_ns = now_ns
        self._sent = Counter[str]()

        # For its topic
        first_levels = prefix.rstrip("/") or f"{interface}/v{version[0]}"
        self._prefix = f"{first_levels}/{manufacturer}/{serial_number}"

    def topic(self, name: str) -> str:
        """Return the MQTT topic for `name`, such as `order` or `state`."""
        return f"{self._prefix}/{name}"

    def order(self, order: Order, map_id: str) -> tuple[str, str]:
        """Return topic and payload of an order on the map `map_id`."""
        nodes = [_node(order, node, map_id) for node in order.nodes]
        edges = [_edge(order, start, end) for start, end in pairwise(order.nodes)]
        ids = {"orderId": order.order_id, "orderUpdateId": order.update_id}
        return self._message("order", {**ids, "nodes": nodes, "edges": edges})

    def actions(self, actions: Sequence[InstantAction]) -> tuple[str, str]:
        """Return topic and payload of instant actions."""
        contents: list[dict[str, str]] = []
        for action in actions:
            content = {"actionType": action.action_type, "actionId": action.action_id}
            contents.append({**content, "blockingType": "NONE"})
        body: dict[str, Any] = {"instantActions": contents}
        if self._version[0] != "1":  # renamed in version 2, not in its first schemas: AGVs ignore the other
            body["actions"] = contents
        return self._message("instantActions", body)

    def _message(self, name: str, body: dict[str, Any]) -> tuple[str, str]:
        header_id = self._sent[name] % (1 << 32)
        header = {
            "headerId": header_id,
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
    x = round(node.x, 4)
    y = round(node.y, 4)
    position: dict[str, Any] = {"x": x, "y": y, "mapId": map_id}
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
    sequence_id = end.sequence_id - 1
    edge: dict[str, Any] = {
        "edgeId": f"{order.order_id}.{sequence_id}",
        "sequenceId": sequence_id,
        "released": True,
        "startNodeId": node_id(order.order_id, start.sequence_id),
        "endNodeId": node_id(order.order_id, end.sequence_id),
        "actions": [],
    }
    if order.max_speed_mps is not None:
        edge["maxSpeed"] = order.max_speed_mps
    return edge


class Route:
    """Way-points ahead of the nodes that were handed out."""

    def __init__(self) -> None:
        self._ahead: deque[Point] = deque()

    def __bool__(self) -> bool:
        """Return True if there is a way ahead."""
        return bool(self._ahead)

    @property
    def end(self) -> Point | None:
        """Return the last way-point, or None if there is no way ahead."""
        return self._ahead[-1] if self._ahead else None

    def replace(self, points: Iterable[Point]) -> None:
        """Forget the way ahead, and go along `points`."""
        self._ahead = deque(points)

    def next_node(self, start: Point, step_m: float) -> Point | None:
        """Return the place of the next node behind one at `start`, `step_m` away at most.

        Way-points are nodes, and the line to a way-point that is farther away is divided evenly. Returns None
        at the end of the way.
        """
        x, y = start
        while self._ahead:
            point = self._ahead[0]
            distance_m = math.dist(start, point)
            if distance_m > step_m:
                part = 1.0 / math.ceil(distance_m / step_m)
                return (x + part * (point[0] - x), y + part * (point[1] - y))
            self._ahead.popleft()
            if distance_m > SAME_M:
                return point
        return None


def has_other_master(state: AgvState) -> bool:
    """Return True if the AGV carries out an order that is not ours."""
    return state.is_executing and not state.order_id.startswith(PREFIX)


@dataclass(frozen=True)
class _Sent:
    """The order that the AGV carries out, or should."""

    order: Order
    """As sent last."""
    sent_s: float
    tries: int = 1
    is_confirmed: bool = False
    reached: int = 0
    """Sequence id of the last node that was reached."""

    @property
    def last(self) -> OrderNode:
        return self.order.nodes[-1]


class AgvOrders:
    """Selects the orders for one AGV.

    An order is handed out in steps: at most four nodes ahead of the AGV are released, and updates append to
    them. A new target therefore replaces the way beyond the next nodes without a stop. By the standard, an
    AGV that loses its connection continues to its last released node, here `base_m` at most. No order is sent
    before the AGV has reported its state, or while it executes an order of another master.
    """

    def __init__(self, session: str, base_m: float, interval_s: float, tell: Tell) -> None:
        """Create without an order and without a connection.

        Args:
            session: makes the ids of orders differ from those of other runs.
            base_m: length of the way that is released ahead of the AGV, m.
            interval_s: shortest time between two orders, s.
            tell: receives the results of commands.
        """
        self.session = f"{PREFIX}{session}"
        """Beginning of the ids of this run."""
        self._step_m = base_m / NODES_AHEAD
        self._interval_s = interval_s
        self._report_outcome = tell
        self._id_count = 0
        self._is_linked = False

        # The command, and the way that is not handed out yet
        self._number = 0
        self._route = Route()
        self._yaw_rad: float | None = None
        self._speed_mps: float | None = None
        self._is_path = False
        self._is_accepted = False
        """True after the AGV has accepted the first order of a path."""

        # What the AGV reports
        self._position: Point | None = None
        self._blocked = ""
        self._is_paused = False
        self._state: AgvState | None = None
        """Newest state since the AGV was connected, or None."""

        # What it has to answer: an order, or a cancellation
        self._sent: _Sent | None = None
        self._last_order_s = -math.inf
        self._is_cancelling = False
        """True until a cancellation is answered."""
        self._cancel_ids: deque[str] = deque(maxlen=64)
        """Ids of this cancellation, a new one each time it is sent: the AGV may answer any of them, late."""
        self._cancel_s = -math.inf
        self._cancel_tries = 0
        self._stop_number = 0
        """Number of the stop that the cancellation is for, or 0."""

    @property
    def has_state(self) -> bool:
        """Return True if the AGV has reported its state since it was connected."""
        return self._state is not None

    @property
    def is_active(self) -> bool:
        """Return True from a command to its end, while the AGV may move."""
        has_order = self._sent is not None or bool(self._route)
        is_stopping = self._is_cancelling or self._stop_number != 0
        return has_order or is_stopping

    @property
    def problem(self) -> str:
        """Return a sentence if the AGV does not stop, or does not start, else `""`."""
        if self._is_cancelling and self._cancel_tries > MAX_TRIES:
            return (
                "the AGV does not confirm that it stops: press its emergency stop, and look at its connection"
            )
        if self._is_paused:
            return "the AGV is paused: press its button, or let its master go on"
        return ""

    def follow(self, number: int, target: Point, yaw_rad: float | None, speed_mps: float | None) -> None:
        """Go to `target`, m. This replaces the previous order."""
        if not self._is_linked or self._is_refused(number):
            return
        self._number = number
        self._is_path = False

        # A target that hardly differs from the end of the way is not worth an order
        end = self._route.end
        if end is None and self._sent is not None:
            end = self._sent.last.place
        elif end is None:
            end = self._position
        if end is not None and math.dist(end, target) < SAME_TARGET_M:
            return
        self._yaw_rad = yaw_rad
        self._speed_mps = speed_mps
        self._route.replace([target])

    def drive(
        self, number: int, points: Sequence[Point], yaw_rad: float | None, speed_mps: float | None
    ) -> None:
        """Go along `points`, m. This replaces the previous order."""
        if not self._is_linked or self._is_refused(number):
            return
        self._number = number
        self._is_path = True
        self._is_accepted = False
        self._yaw_rad = yaw_rad
        self._speed_mps = speed_mps
        self._route.replace(points)

    def stop(self, number: int) -> None:
        """Cancel our order, also one of an earlier run, which the AGV's state reports."""
        self._number = 0
        self._stop_number = number
        if self._sent:
            self._cancel()
        self._drop_order()
        if self._state is not None:
            self._on_state_without_order(self._state)

    def on_connected(self, position: Point) -> None:
        """Set that the AGV is connected, and where it is, m."""
        self._position = position
        self._is_linked = True
        self._cancel_s = -math.inf

    def on_disconnected(self) -> None:
        """Set that the AGV is not connected, and forget what was ordered."""
        self._is_linked = False
        self._state = None
        if self._sent or self._route:
            self._finish("failed", "the connection to the AGV is lost")

    def on_position(self, position: Point) -> None:
        """Set where the AGV is, m."""
        self._position = position

    def on_state(self, state: AgvState) -> None:
        """Compare a state, newer than the previous ones, with the order."""
        self._state = state
        self._blocked = OTHER_MASTER if has_other_master(state) else blocked_by(state)
        self._is_paused = state.paused and state.is_executing

        # An order of another master is not ours to cancel
        if has_other_master(state):
            self._sent = None
            self._is_cancelling = False
            self._finish("failed", OTHER_MASTER)
            self._end_stop()
            return

        # A cancellation is to end before anything else begins
        if self._is_cancelling:
            self._check_cancelled(state)
            return
        if self._blocked and (self._sent or self._route):
            self._finish("refused", self._blocked)
            return
        if self._sent is None:
            self._on_state_without_order(state)
            return

        # Our order: confirmed, replaced by somebody else's, or refused
        if state.order_id == self._sent.order.order_id:
            self._check_progress(self._sent, state)
        elif self._sent.is_confirmed:
            self._sent = None
            self._finish("failed", OTHER_MASTER)
        if self._sent is not None and not self._sent.is_confirmed:
            self._check_refusal(self._sent.order, state)

    def step(self, now_s: float) -> list[Order | InstantAction]:
        """Return the messages to send at `now_s`; a cancellation also to an AGV that knows no place."""
        if self._state is None:
            return []
        if self._is_cancelling:
            return self._send_cancellation(now_s)
        if not self._is_linked:
            return []
        if self._sent is not None and not self._sent.is_confirmed:
            return self._send_again(self._sent, now_s)
        if not self._route or now_s - self._last_order_s < self._interval_s:
            return []

        # The next part of the way: by a new order, or by an update of the present one
        reached = 0
        if self._sent is None:
            order = self._first_order()
        else:
            reached = self._sent.reached
            order = self._update(self._sent)
        if order is None:
            return []
        self._last_order_s = now_s
        self._sent = _Sent(order, now_s, reached=reached)
        return [order]

    def _first_order(self) -> Order | None:
        assert self._position is not None, "known while it is linked"  # noqa: S101 - for the type checkers
        start = OrderNode(0, *self._position)
        nodes = self._nodes_behind(start, NODES_AHEAD)
        if not nodes:  # it is there
            self._arrive()
            return None
        return Order(self._next_id(), 0, (start, *nodes), self._speed_mps)

    def _next_id(self) -> str:
        """Return an id that no other order or action of ours has."""
        self._id_count += 1
        return f"{self.session}-{self._id_count}"

    def _update(self, sent: _Sent) -> Order | None:
        ahead = (sent.last.sequence_id - sent.reached) // 2
        nodes = self._nodes_behind(sent.last, NODES_AHEAD - ahead)
        if not nodes:
            return None
        update_id = sent.order.update_id + 1
        return Order(sent.order.order_id, update_id, (sent.last, *nodes), self._speed_mps)

    def _nodes_behind(self, node: OrderNode, number: int) -> tuple[OrderNode, ...]:
        nodes: list[OrderNode] = []
        while len(nodes) < number:
            place = self._route.next_node(node.place, self._step_m)
            if place is None:
                break
            theta = self._yaw_rad if not self._route else None
            node = OrderNode(node.sequence_id + 2, *place, theta=theta)
            nodes.append(node)
        return tuple(nodes)

    def _send_again(self, sent: _Sent, now_s: float) -> list[Order | InstantAction]:
        if now_s - sent.sent_s < RESEND_S:
            return []
        if sent.tries >= MAX_TRIES:
            self._finish("failed", "the AGV does not answer: look at its mode and its connection")
            return self._send_cancellation(now_s)
        self._sent = replace(sent, sent_s=now_s, tries=sent.tries + 1)
        return [sent.order]

    def _check_progress(self, sent: _Sent, state: AgvState) -> None:
        # The last node may still be one of the order before
        if state.last_node_id == node_id(state.order_id, state.last_node_sequence_id):
            reached = max(sent.reached, state.last_node_sequence_id)
            sent = replace(sent, reached=reached)
        if not sent.is_confirmed and state.order_update_id >= sent.order.update_id:
            sent = replace(sent, is_confirmed=True)
            if self._is_path and not self._is_accepted:
                self._is_accepted = True
                self._report_outcome(self._number, "accepted", "")
        self._sent = sent
        if state.is_executing:
            return

        # It has ended: at the last node that it has accepted, or cancelled before
        end = sent.order.nodes[0]
        if sent.is_confirmed:
            end = sent.last
            self._sent = None
        if sent.reached < end.sequence_id:
            self._finish("cancelled", "it was cancelled at the AGV, or by another master control")
        elif sent.is_confirmed and not self._route:
            self._arrive()

    def _check_refusal(self, order: Order, state: AgvState) -> None:
        update_id = str(order.update_id)
        for error in state.errors:
            if not error.is_about("orderId", order.order_id):
                continue
            if error.is_about("orderUpdateId", update_id, default=True):
                self._finish("refused", error.describe())
                return

    def _check_cancelled(self, state: AgvState) -> None:
        # an answer is waited for: an order that is still on its way to the AGV would be carried out later
        if state.is_executing:
            return
        is_cleared = bool(self._blocked)  # by hand, without an answer
        if is_cleared or self._is_cancellation_answered(state):
            self._is_cancelling = False
            self._end_stop()

    def _is_cancellation_answered(self, state: AgvState) -> bool:
        for action in state.action_states:
            if action.action_id in self._cancel_ids and action.action_status in ("FINISHED", "FAILED"):
                return True

        # An error is an answer, too: there is nothing to cancel
        for error in state.errors:
            for action_id in self._cancel_ids:
                if error.is_about("actionId", action_id):
                    return True
        return False

    def _on_state_without_order(self, state: AgvState) -> None:
        """Cancel our order that nobody steers; else a stop is done."""
        if state.is_executing and not has_other_master(state):
            self._cancel()
        elif not self._is_cancelling:
            self._end_stop()

    def _end_stop(self) -> None:
        if self._stop_number:
            self._report_outcome(self._stop_number, "done", "")
            self._stop_number = 0

    def _send_cancellation(self, now_s: float) -> list[Order | InstantAction]:
        if now_s - self._cancel_s < RESEND_S:
            return []
        self._cancel_s = now_s
        self._cancel_tries += 1
        action_id = self._next_id()
        self._cancel_ids.append(action_id)
        return [InstantAction("cancelOrder", action_id)]

    def _arrive(self) -> None:
        if self._number and self._is_path:
            self._report_outcome(self._number, "done", "")
        self._number = 0

    def _is_refused(self, number: int) -> bool:
        """Refuse a command if the AGV carries out none, and return True then."""
        if not self._blocked:
            return False
        self._number = number
        self._finish("refused", self._blocked)
        return True

    def _finish(self, outcome: Outcome, reason: str) -> None:
        """End the command, stop the AGV, and report the reason."""
        if self._sent is not None:
            self._cancel()
        self._drop_order()
        number = self._number
        self._number = 0
        self._report_outcome(number, outcome, reason)

    def _drop_order(self) -> None:
        self._sent = None
        self._route.replace([])

    def _cancel(self) -> None:
        if not self._is_cancelling:
            self._is_cancelling = True
            self._cancel_ids.clear()
            self._cancel_s = -math.inf
            self._cancel_tries = 0
