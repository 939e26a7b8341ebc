"""One AGV by VDA 5050: what it says, its parameters, and the messages to it.

No core: it sends messages of a broker.
"""

import math
from collections.abc import Callable
from itertools import chain
from typing import Annotated

from pydantic import Field, StringConstraints

from pointit.geometry.vector import Vec3, wrap
from pointit.runtime.mqtt.broker_config import BrokerConfig
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import NS_PER_S
from pointit.schemas.message_age import SenderClock
from pointit.services.robot.drivers.agv_orders import (
    AgvOrders,
    InstantAction,
    MessageEncoder,
    Order,
    Outcome,
    Point,
    Version,
    has_other_master,
)
from pointit.services.robot.robot_driver import (
    Command,
    Follow,
    FollowPath,
    Land,
    LinkLost,
    OrderStatus,
    Report,
    RobotReport,
    RobotSpec,
    TakeOff,
)
from pointit.vda5050 import (
    LOST_CONNECTIONS,
    AgvConnection,
    AgvState,
    TimestampCheck,
    UnreadableFields,
    Visualization,
    parse,
)

TopicLevel = Annotated[str, StringConstraints(max_length=200, pattern=r"^[^/#+\x00]*$")]
MqttPublication = tuple[str, str]
"""MQTT topic and payload."""

REPEAT_S = 0.08
"""Age of a report that is repeated while the AGV stands, s. It sends its state when it begins to drive."""
POLL_S = 0.4
"""Time without a message at which an AGV that has an order is asked for its state, s."""
MAX_AGV_AGE_S = 35.0
"""Age of the newest message from which an AGV counts as lost, s. By the standard it sends one every 30 s."""

FARTHEST_M = 1e6
"""Limit of coordinates, m."""
SLOWEST_MPS = 0.05
"""Smallest speed that is ordered, m/s; at 0 an AGV would never arrive."""


class Vda5050Config(BrokerConfig):
    """One AGV on an MQTT broker."""

    manufacturer: TopicLevel = Field(default="", description="manufacturer of the AGV, as in its topics")
    serial_number: TopicLevel = Field(default="", description="serial number of the AGV, as in its topics")
    interface: TopicLevel = Field(default="uagv", description="first level of the topics")
    topic_prefix: str = Field(
        default="",
        max_length=200,
        pattern=r"^[^#+\x00]*$",
        description="levels of the topics before the manufacturer, such as hall/uagv/2.0; interface and "
        "major version if empty",
    )
    version: Version = Field(default="2.0.0", description="version of VDA 5050 that the AGV understands")
    map_id: str = Field(
        default="",
        max_length=200,
        description="map of the AGV in which its positions count; the one that it is on if empty",
    )
    base_m: float = Field(
        default=1.0,
        ge=0.2,
        le=100,
        description="length of the way ahead that is released, and driven also without a connection, m",
    )
    max_order_rate_hz: float = Field(
        default=2.0,
        gt=0,
        le=20,
        description="maximum number of orders and updates per second, since an AGV plans again at each",
    )


class Agv:
    """Keeps what one AGV says apart from the orders sent to it."""

    def __init__(self, config: Vda5050Config, spec: RobotSpec, surroundings: Surroundings) -> None:
        self._config = config
        self._spec = spec
        self._surroundings = surroundings
        self._report: Report = lambda _item: None

        # What is sent to the AGV
        now_ns: Callable[[], int] = surroundings.clock.now_ns
        self._encoder = MessageEncoder(
            config.interface,
            config.version,
            config.manufacturer,
            config.serial_number,
            now_ns,
            prefix=config.topic_prefix,
        )
        session = f"{now_ns():x}"
        interval_s = 1.0 / config.max_order_rate_hz
        self._orders = AgvOrders(session, config.base_m, interval_s, self._report_outcome)

        # To recognize messages that are old, repeated or unreadable, and an AGV that is off
        self._timestamps = {"state": TimestampCheck(), "visualization": TimestampCheck()}
        self._unreadable = {name: UnreadableFields() for name in (*self._timestamps, "connection")}
        self._clock = SenderClock(round(MAX_AGV_AGE_S * NS_PER_S))
        self._is_off = False
        """True from a message by which the AGV has left to the next message of now."""
        self._is_up = False
        """True while the broker is connected."""
        self._polls = 0

        # What it has reported
        self._last: RobotReport | None = None
        """Newest report, or None while the AGV is not connected."""
        self._lost = ""
        self._map_id = config.map_id
        self._is_driving = False
        self._has_other_master = False
        self._battery: float | None = None
        self._received_s = 0.0
        self._polled_s = 0.0
        self._repeated_s = 0.0

    @property
    def is_active(self) -> bool:
        """Return True while an order permits the AGV to move."""
        return self._orders.is_active

    def topic(self, name: str) -> str:
        """Return the MQTT topic `name`, such as `state`, of the AGV."""
        return self._encoder.topic(name)

    def set_report(self, report: Report) -> None:
        """Set the receiver of events."""
        self._report = report

    def on_connected(self) -> MqttPublication:
        """Wait for the AGV at a broker that is connected now. Returns a question for its state.

        Some AGVs report every 30 s only: nobody is to wait for that.
        """
        self._is_up = True
        self._is_off = False
        self._clock.start()
        self._polled_s = math.inf  # at the next step
        self._disconnect(
            f"no AGV reports at {self.topic('state')} on {self._config.broker}: switch it on, or correct "
            "`manufacturer`, `serial_number`, `interface`, `version` or `topic_prefix`"
        )
        return self._state_request()

    def on_disconnected(self, reason: str) -> None:
        """Forget the AGV, since the broker is not connected for `reason`."""
        self._is_up = False
        self._disconnect(reason)

    def on_message(self, topic: str, payload: object, now_s: float, *, is_retained: bool = False) -> None:
        """Use a message of the broker, as far as it can be read and is not old.

        Health names the fields that cannot be read.
        """
        name = topic.rpartition("/")[2]
        kinds: dict[str, type[AgvConnection | Visualization]] = {
            "connection": AgvConnection,
            "state": AgvState,
        }
        message = parse(kinds.get(name, Visualization), payload)
        problem = ""
        if message is None:
            problem = (
                f"{topic}: a message is not one of VDA 5050 {self._config.version} and is dropped; correct "
                "`version`, or update the AGV"
            )
        elif name in self._unreadable:
            problem = self._unreadable[name].describe(topic, message)
        self._surroundings.health.warn("message", problem, name)
        if isinstance(message, AgvConnection):
            self._on_connection(message)
            return
        if message is None or name not in self._timestamps:
            return

        # The broker keeps old messages, and the network may deliver some twice or in another order
        now_ns = self._surroundings.clock.now_ns()
        age_s = self._clock.age_ns(message.stamp_ns, now_ns, is_retained=is_retained) / NS_PER_S
        if age_s > MAX_AGV_AGE_S:
            self._on_old_message(age_s)
            return
        if not self._timestamps[name].is_new(message.timestamp):
            return

        # The pose comes before the orders, which need to know where the AGV is
        self._is_off = False
        self._received_s = now_s - age_s
        if isinstance(message, AgvState):
            self._is_driving = message.driving is not False
            self._has_other_master = has_other_master(message)
            self._battery = None if message.charge is None else message.charge / 100
        self._on_pose(message)
        if isinstance(message, AgvState):
            self._orders.on_state(message)

    def command(self, command: Command) -> None:
        """Carry out `command`, unless an AGV cannot."""
        problem = _problem(command)
        if problem:
            self._report(OrderStatus(command.order, "refused", problem))
            return
        if isinstance(command, Follow):
            x, y, _z = command.position_m
            yaw_rad = _wrapped(command.yaw_rad)
            self._orders.follow(command.order, (x, y), yaw_rad, self._speed_mps(command))
        elif isinstance(command, FollowPath):
            points = [(x, y) for x, y, _z in command.points_m]
            yaw_rad = _wrapped(command.yaw_rad)
            self._orders.drive(command.order, points, yaw_rad, self._speed_mps(command))
        else:
            self._orders.stop(command.order)

    def step(self, now_s: float) -> list[MqttPublication]:
        """Return the messages to publish at `now_s`, and report an AGV that stands."""
        if not self._is_up:
            return []
        if self._last is not None and now_s - self._received_s > MAX_AGV_AGE_S:
            self._disconnect(f"the AGV has sent nothing for {MAX_AGV_AGE_S:.0f} s: look at its network")
        publications = [self._encoded(message) for message in self._orders.step(now_s)]
        self._surroundings.health.warn("agv", self._orders.problem)

        # An AGV that stands sends hardly anything: its last report is repeated
        is_resting = not self._is_driving and not self._orders.is_active
        reported_s = max(self._received_s, self._repeated_s)
        if self._last is not None and is_resting and now_s - reported_s >= REPEAT_S:
            last = self._last
            self._repeated_s = now_s
            self._report_position(last.position_m, last.yaw_rad, (0.0, 0.0), last.position_sigma_m)

        # One that has an order is asked for its state: its position alone is not enough
        self._polled_s = min(self._polled_s, now_s)
        received_s = self._received_s if self._orders.has_state else 0.0
        if self._orders.is_active and now_s - max(received_s, self._polled_s) >= POLL_S:
            self._polled_s = now_s
            publications.append(self._state_request())
        return publications

    def closing_messages(self) -> list[MqttPublication]:
        """Return the messages at the end of the driver: an AGV that may move gets an order to stop."""
        if not self._orders.is_active:
            return []
        self._orders.stop(0)
        return [self._encoded(message) for message in self._orders.step(self._received_s)]

    def _speed_mps(self, command: Follow | FollowPath) -> float:
        speed_mps = self._spec.max_speed_mps
        if command.max_speed_mps is not None:
            speed_mps = min(speed_mps, command.max_speed_mps)
        return max(SLOWEST_MPS, speed_mps)

    def _on_connection(self, connection: AgvConnection) -> None:
        if connection.connection_state == "ONLINE":
            for check in self._timestamps.values():
                check.forget()  # it may have been restarted
            self._clock.start()
            return
        state = connection.connection_state
        if state in LOST_CONNECTIONS:
            self._is_off = True
            self._clock.end(connection.stamp_ns)
            reason = "the AGV is switched off" if state == "OFFLINE" else "the AGV has lost its connection"
            self._disconnect(f"{reason} ({state}): switch it on, or look at its network")

    def _on_old_message(self, age_s: float) -> None:
        """Report that a message is old, unless the AGV has said that it is off, or is connected."""
        if self._is_off or self._last is not None:
            return
        age = "of unknown age, since the broker retains it"
        if math.isfinite(age_s):
            age = f"{age_s:.0f} s old"
        self._disconnect(
            f"the newest message of the AGV is {age}: switch the AGV on, or set its clock if it is on"
        )

    def _on_pose(self, message: Visualization) -> None:
        position = message.agv_position
        if position is None:
            if self._last is None and isinstance(message, AgvState):
                self._disconnect(
                    "the AGV reports no agvPosition: PointIt steers AGVs that know where they are"
                )
            return
        if position.position_initialized is False:
            self._disconnect("the AGV does not know where it is: set its position at the vehicle")
            return
        if self._config.map_id not in ("", position.map_id):
            self._disconnect(_map_problem(self._config.map_id, position.map_id))
            return

        # It knows its place, on the map that counts
        self._map_id = position.map_id
        place = (position.x, position.y)
        if self._last is None:
            self._orders.on_connected(place)
        else:
            self._orders.on_position(place)
        self._lost = ""
        theta = position.theta
        if theta is None:  # health names it
            theta = self._last.yaw_rad if self._last else 0.0
        self._report_position((*place, 0.0), theta, message.velocity_mps, position.deviation_range)

    def _report_position(
        self, position_m: tuple[float, float, float], yaw_rad: float, velocity: Point, sigma_m: float | None
    ) -> None:
        self._last = RobotReport(
            stamp_ns=self._surroundings.clock.now_ns(),
            position_m=position_m,
            yaw_rad=yaw_rad,
            velocity_mps=(*velocity, 0.0),
            position_sigma_m=sigma_m,
            battery=self._battery,
            has_other_master=self._has_other_master,
        )
        self._report(self._last)

    def _disconnect(self, reason: str) -> None:
        self._last = None
        for check in self._timestamps.values():
            check.forget()
        self._orders.on_disconnected()
        if reason != self._lost:
            self._lost = reason
            self._report(LinkLost(reason))

    def _report_outcome(self, number: int, outcome: Outcome, reason: str) -> None:
        if number:
            self._report(OrderStatus(number, outcome, reason))

    def _encoded(self, message: Order | InstantAction) -> MqttPublication:
        if isinstance(message, Order):
            return self._encoder.order(message, self._map_id)
        return self._encoder.actions([message])

    def _state_request(self) -> MqttPublication:
        self._polls += 1
        action_id = f"{self._orders.session}-state-{self._polls}"
        return self._encoder.actions([InstantAction("stateRequest", action_id)])


def _map_problem(map_id: str, agv_map_id: str) -> str:
    """Return the difference between the configured map and that of an AGV, as one sentence."""
    if not agv_map_id:
        return (
            f"the AGV states no mapId, and `map_id` is {map_id!r}: set it at the AGV, or leave `map_id` empty"
        )
    return f"the AGV is on map {agv_map_id[:50]!r}, and not on {map_id!r}: correct `map_id`, or drive it back"


def _problem(command: Command) -> str:
    """Return an error message if an AGV cannot carry out `command`, else `""`."""
    if isinstance(command, TakeOff | Land):
        return "an AGV drives and cannot fly: steer it as a ground robot (`kind: ground`)"
    places: tuple[Vec3, ...] = ()
    if isinstance(command, Follow):
        places = (command.position_m,)
    elif isinstance(command, FollowPath):
        places = command.points_m
        if not places:
            return "there is no such place"
    for value in chain.from_iterable(places):
        if not abs(value) <= FARTHEST_M:  # also if it is not a number
            return "there is no such place"
    return ""


def _wrapped(yaw_rad: float | None) -> float | None:
    return None if yaw_rad is None else wrap(yaw_rad)
