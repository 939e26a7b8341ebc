"""Driver of AGVs by VDA 5050: each AGV, the connection to a broker, and the search for AGVs."""

import asyncio
import contextlib
import math
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, StringConstraints

from pointit.geometry.vector import wrap
from pointit.runtime.clock import wait_up_to
from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.errors import ConfigError, first_cause
from pointit.runtime.mqtt.broker import (
    client_options,
    connected,
    find_on_brokers,
    keep_connected,
    require_client,
)
from pointit.runtime.mqtt.broker_client import BrokerClient, RefusedTopicsError
from pointit.runtime.mqtt.broker_config import PORT, BrokerConfig
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import NS_PER_S
from pointit.schemas.message_age import SenderClock, message_age_ns
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
    RobotPlugin,
    RobotReport,
    RobotSpec,
    TakeOff,
)
from pointit.vda5050 import (
    LOST_CONNECTIONS,
    AgvConnection,
    AgvState,
    AgvTopic,
    TimestampCheck,
    UnreadableFields,
    Visualization,
    agv_of_topic,
    agv_topics,
    parse,
)

if TYPE_CHECKING:
    import aiomqtt


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
MAX_AGVS = 500
"""Limit of AGVs on one broker."""

REPORT_TOPICS = tuple(each for each in agv_topics() if not each.endswith("/visualization"))

TOPICS = (("connection", 1), ("state", 0), ("visualization", 0))
"""Topics of an AGV, with their quality of service by the standard."""

TICK_S = 0.05
"""Maximum interval between two checks for messages to send or results to report, s."""

RETRY_S = 1.0
"""Wait after an error, s."""

ACK_S = 5.0
"""Time for a broker to acknowledge a message, after which the connection counts as lost, s."""

END_S = 0.4
"""Maximum time to stop the AGV at the end, s."""


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
        self._around = surroundings
        self._report: Report = lambda _item: None
        now_ns: Callable[[], int] = surroundings.clock.now_ns
        self._encoder = MessageEncoder(
            config.interface,
            config.version,
            config.manufacturer,
            config.serial_number,
            now_ns,
            prefix=config.topic_prefix,
        )
        self._orders = AgvOrders(
            f"{now_ns():x}", config.base_m, 1.0 / config.max_order_rate_hz, self._report_outcome
        )
        self._timestamps = {"state": TimestampCheck(), "visualization": TimestampCheck()}
        self._unreadable = {name: UnreadableFields() for name in (*self._timestamps, "connection")}
        self._clock = SenderClock(round(MAX_AGV_AGE_S * NS_PER_S))
        self._is_off = False
        """True from a message by which the AGV has left to the next message of now."""
        self._is_up = False
        """True while the broker is connected."""
        self._polls = 0
        self._last: RobotReport | None = None
        """Newest report, or None while the AGV is not connected."""
        self._lost = ""
        self._map_id = config.map_id
        self._is_driving = self._has_other_master = False
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
        if message is None:
            problem = (
                f"{topic}: a message is not one of VDA 5050 {self._config.version} and is dropped; correct "
                "`version`, or update the AGV"
            )
        else:
            problem = self._unreadable[name].describe(topic, message) if name in self._unreadable else ""
        self._around.health.warn("message", problem, name)
        if isinstance(message, AgvConnection):
            self._on_connection(message)
        elif message is not None and name in self._timestamps:
            now_ns = self._around.clock.now_ns()
            age_s = self._clock.age_ns(message.stamp_ns, now_ns, is_retained=is_retained) / NS_PER_S
            if age_s > MAX_AGV_AGE_S:
                self._on_old_message(age_s)
                return
            if not self._timestamps[name].is_new(message.timestamp):
                return
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
            self._orders.follow(command.order, (x, y), _wrapped(command.yaw_rad), self._speed_mps(command))
        elif isinstance(command, FollowPath):
            points = [(x, y) for x, y, _z in command.points_m]
            self._orders.drive(command.order, points, _wrapped(command.yaw_rad), self._speed_mps(command))
        else:
            self._orders.stop(command.order)

    def step(self, now_s: float) -> list[MqttPublication]:
        """Return the messages to publish at `now_s`, and report an AGV that stands."""
        if not self._is_up:
            return []
        if self._last is not None and now_s - self._received_s > MAX_AGV_AGE_S:
            self._disconnect(f"the AGV has sent nothing for {MAX_AGV_AGE_S:.0f} s: look at its network")
        publications = [self._written(each) for each in self._orders.step(now_s)]
        self._around.health.warn("agv", self._orders.problem)
        is_resting = not (self._is_driving or self._orders.is_active)
        if (
            self._last is not None
            and is_resting
            and now_s - max(self._received_s, self._repeated_s) >= REPEAT_S
        ):
            self._repeated_s = now_s
            self._report_position(
                self._last.position_m, self._last.yaw_rad, (0.0, 0.0), self._last.position_sigma_m
            )
        self._polled_s = min(self._polled_s, now_s)
        received_s = self._received_s if self._orders.has_state else 0.0  # its place alone does not tell
        if self._orders.is_active and now_s - max(received_s, self._polled_s) >= POLL_S:
            self._polled_s = now_s
            publications.append(self._state_request())
        return publications

    def closing_messages(self) -> list[MqttPublication]:
        """Return the messages at the end of the driver: an AGV that may move gets an order to stop."""
        if not self._orders.is_active:
            return []
        self._orders.stop(0)
        return [self._written(each) for each in self._orders.step(self._received_s)]

    def _speed_mps(self, command: Follow | FollowPath) -> float:
        own_mps = self._spec.max_speed_mps
        limit_mps = command.max_speed_mps
        return max(SLOWEST_MPS, own_mps if limit_mps is None else min(own_mps, limit_mps))

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
        age = f"{age_s:.0f} s old" if math.isfinite(age_s) else "of unknown age, since the broker retains it"
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
        map_id = self._config.map_id
        if map_id not in ("", position.map_id):
            self._disconnect(
                f"the AGV is on map {position.map_id[:50]!r}, and not on {map_id!r}: correct `map_id`, or "
                "drive it back"
                if position.map_id
                else f"the AGV states no mapId, and `map_id` is {map_id!r}: set it at the AGV, or leave "
                "`map_id` empty"
            )
            return
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
            stamp_ns=self._around.clock.now_ns(),
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

    def _written(self, message: Order | InstantAction) -> MqttPublication:
        if isinstance(message, Order):
            return self._encoder.order(message, self._map_id)
        return self._encoder.actions([message])

    def _state_request(self) -> MqttPublication:
        self._polls += 1
        action_id = f"{self._orders.session}-state-{self._polls}"
        return self._encoder.actions([InstantAction("stateRequest", action_id)])


def _problem(command: Command) -> str:
    """Return an error message if an AGV cannot carry out `command`, else `""`."""
    if isinstance(command, TakeOff | Land):
        return "an AGV drives and cannot fly: steer it as a ground robot (`kind: ground`)"
    places = command.points_m if isinstance(command, FollowPath) else ()
    if isinstance(command, Follow):
        places = (command.position_m,)
    is_place = all(abs(value) <= FARTHEST_M for place in places for value in place)  # also if it is a number
    if not is_place or (isinstance(command, FollowPath) and not places):
        return "there is no such place"
    return ""


def _wrapped(yaw_rad: float | None) -> float | None:
    return None if yaw_rad is None else wrap(yaw_rad)


async def find_agvs(seconds: float) -> Sequence[FoundDevice]:
    """Return the AGVs on the broker of this machine and on brokers that announce themselves (`_mqtt._tcp`).

    Raises:
        ConfigError: If the extra `mqtt` is not installed.
    """
    require_client("AGVs by VDA 5050")
    return await find_on_brokers(find_agvs_on, seconds)


async def find_agvs_on(host: str, port: int, seconds: float) -> list[FoundDevice]:
    """Return the AGVs that report on one broker within `seconds`.

    Nothing if there is no broker, and the broker itself if it refuses to show them.
    """
    from aiomqtt import MqttError  # noqa: PLC0415 - an extra

    address = host if port == PORT else f"{host}:{port}"
    found: dict[AgvTopic, FoundDevice] = {}
    try:
        async with asyncio.timeout(seconds), connected({"hostname": host, "port": port}) as client:
            await client.subscribe([(topic, 1) for topic in REPORT_TOPICS])
            async for message in client.messages:
                agv = agv_of_topic(str(message.topic))
                if agv is not None and len(found) < MAX_AGVS:
                    _note_agv(found, address, agv, message)
    except RefusedTopicsError as error:
        return [FoundDevice(address, f"MQTT broker: {error}")]
    except (MqttError, OSError):  # the end of the search, a TimeoutError, is an OSError
        pass
    return list(found.values())


def _note_agv(
    found: dict[AgvTopic, FoundDevice], address: str, agv: AgvTopic, message: "aiomqtt.Message"
) -> None:
    """Store the sender of `message` in `found`, unless the message is not from an AGV.

    Of an AGV that is off, the broker retains a state as well: that does not count as one of now.
    """
    content = parse(AgvConnection if agv.kind == "connection" else AgvState, message.payload)
    if content is None:
        return
    key = agv._replace(kind="")
    if isinstance(content, AgvConnection):
        found[key] = _found(address, agv, content.connection_state or "no connectionState")
        return
    age_ns = message_age_ns(content.stamp_ns, time.time_ns(), is_retained=message.retain)
    if age_ns <= MAX_AGV_AGE_S * NS_PER_S:
        found[key] = _found(address, agv, "ONLINE")
        return
    found.setdefault(key, _found(address, agv, "without a message of now"))


def _found(address: str, agv: AgvTopic, state: str) -> FoundDevice:
    details = {"broker": address, "manufacturer": agv.manufacturer, "serial_number": agv.serial_number}
    interface, _, major = agv.prefix.partition("/v")
    details["interface"] = interface
    if major == "1":
        details["version"] = "1.1.0"
    label = f"{agv.manufacturer} {agv.serial_number}: AGV of VDA 5050 {major}"
    return FoundDevice(address, f"{label}, {state}", details)


def check(config: Vda5050Config) -> None:
    """Check that an AGV can be reached by `config`, as far as can be said without the broker.

    Raises:
        ConfigError: If the extra is missing, the AGV is not named, or a file cannot be read.
    """
    require_client("AGVs by VDA 5050")
    for name in ("broker", "manufacturer", "serial_number"):
        if not getattr(config, name):
            raise ConfigError(f"{name}: is missing; `pointit devices` shows the AGVs of a broker")
    client_options(config)


class Vda5050Driver:
    """Steers one AGV as its master control."""

    def __init__(self, config: Vda5050Config, spec: RobotSpec, surroundings: Surroundings) -> None:
        """Prepare; nothing is opened yet.

        Raises:
            ConfigError: If the extra is missing, the AGV is not named, or a file cannot be read.
        """
        check(config)
        self._options = client_options(config)
        self._has_user = bool(config.username)
        self._health = surroundings.health
        self._agv = Agv(config, spec, surroundings)
        self._changed = asyncio.Event()

    def command(self, command: Command) -> None:
        """Carry out `command`, which replaces those before. Returns at once."""
        self._agv.command(command)
        self._changed.set()

    async def run(self, report: Report) -> None:
        """Report until cancelled, then stop the AGV if it may move."""
        self._agv.set_report(report)
        await keep_connected(self._serve, self._agv.on_disconnected, has_user=self._has_user, retry_s=RETRY_S)

    async def _serve(self) -> None:
        """Connect, and steer until the connection is lost; whatever else ends it stops the AGV first."""
        from aiomqtt import MqttError  # noqa: PLC0415 - an extra

        async with connected(self._options) as client:
            try:
                async with asyncio.TaskGroup() as tasks:
                    tasks.create_task(self._read(client), name="AGV's messages")
                    tasks.create_task(self._send(client), name="AGV's orders")
            except BaseException as error:
                cause = first_cause(error)
                is_connected = isinstance(cause, RefusedTopicsError)
                if is_connected or not isinstance(cause, MqttError | OSError):
                    await self._end(client)
                raise

    async def _read(self, client: BrokerClient) -> None:
        loop = asyncio.get_running_loop()
        async for message in client.messages:
            self._agv.on_message(str(message.topic), message.payload, loop.time(), is_retained=message.retain)
            self._changed.set()

    async def _send(self, client: BrokerClient) -> None:
        loop = asyncio.get_running_loop()
        topics = [(self._agv.topic(name), qos) for name, qos in TOPICS]
        optional = [self._agv.topic("visualization")]
        self._health.warn("subscription", await client.subscribe(topics, optional))
        await self._publish(client, self._agv.on_connected())
        while True:
            self._changed.clear()
            for publication in self._agv.step(loop.time()):
                await self._publish(client, publication)
            await wait_up_to(self._changed, TICK_S)

    async def _publish(self, client: BrokerClient, publication: MqttPublication) -> None:
        topic, payload = publication
        # acknowledged, so that a broker that hangs is noticed; the AGV subscribes without, by the standard
        await client.publish(topic, payload, timeout=ACK_S)

    async def _end(self, client: BrokerClient) -> None:
        """Stop the AGV."""
        from aiomqtt import MqttError  # noqa: PLC0415 - an extra

        # without a connection, the AGV ends at its last released node
        with contextlib.suppress(MqttError, OSError):
            for topic, payload in self._agv.closing_messages():
                await client.publish(topic, payload, timeout=END_S)


VDA5050 = RobotPlugin(
    summary="an AGV by VDA 5050 over MQTT, with PointIt as its master control",
    config=Vda5050Config,
    make=Vda5050Driver,
    check=check,
    discover=find_agvs,
)
