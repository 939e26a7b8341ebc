"""Watches with Wear OS and the Touch SDK app: orientation, pinch, crown, swipe and vibration.

Bytes are those of the maker's public specification. They were tested against the maker's own client and a
simulated watch over a complete Bluetooth stack of others, never against a real watch.

No core: it waits for a radio.
"""

import asyncio
import logging
import math
import platform
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal

from pydantic import Field

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.runtime.config.parameters import set_option
from pointit.runtime.machine import this_machine
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import Feedback
from pointit.schemas.base import unit_quaternion
from pointit.services.imu_bridge.ble import touch_sdk_messages
from pointit.services.imu_bridge.ble.ble_source import BleSource, discover_ble
from pointit.services.imu_bridge.ble.radio import Advertisement, describe_error, require_bleak
from pointit.services.imu_bridge.ble.touch_sdk_messages import (
    BEGIN,
    CANCEL,
    END,
    SensorFrame,
    TouchEvent,
    Update,
    WatchInfo,
)
from pointit.services.imu_bridge.ble.wrist import (
    BleConfig,
    Connection,
    Kind,
    LinkError,
    Obstacle,
    Wrist,
    WristItem,
    vibration_pulses,
)
from pointit.services.imu_bridge.sources import (
    Battery,
    ImuSource,
    Item,
    Press,
    RawReading,
    Reading,
    Reconnected,
    StepGesture,
)

log = logging.getLogger(__name__)

NS_PER_MS = 1_000_000
MAX_DELTA_MS = 10_000
"""Longest time between two frames that is believed, ms."""
MAX_UNIX_MS = 2**62 // NS_PER_MS

MIN_SHARE = 0.2
"""Shortest swipe, as a share of the screen's width."""
USUAL_WIDTH_PX = 450.0
"""Width of the screen of a watch that does not state it, px."""
ID_COMPANY = 0xFFFF
"""Company under which the id of the watch is advertised."""
ID_LENGTH = 4
REPLY_S = 3.0
"""Time limit of the introduction and of a read, s. A watch may answer them only after the approval."""
DECLINED_S = 60.0
"""Pause before a person who has declined is asked again, s."""
ENDED_S = 10.0
"""Pause before a watch whose app has ended is searched again, s."""
CUT = 5
"""Number of unreadable messages of one length from which they are cut."""
MAX_STEPS = 5
"""Largest number of steps of the crown that one message makes."""
VIBRATION = 1.0
"""Intensity of cues, 0 to 1."""
_HALF_TURN: Quaternion = (0.0, 0.0, 1.0, 0.0)
_APPROVAL = Obstacle(
    "waits for approval: open its app and confirm the connection to this machine on the watch", 60.0
)
_ASLEEP = Obstacle(
    "is connected but silent: wake it, keep its app in the foreground, and switch battery optimisation off "
    "for the app",
    20.0,
)
_UNREADABLE = Obstacle("sends messages that cannot be read: update its app and PointIt", 20.0)
_NO_ORIENTATION = Obstacle(
    "sends no orientation that can be used: try "
    f"{set_option('imu-bridge', 'touch_sdk.orientation', 'fusion')}, or update its app",
    20.0,
)


class FrameTimes:
    """Clock of one watch: its Unix time if it sends it, else the sum of its times between frames.

    The last frame of a message has the time of the message, each other one its distance before.
    """

    def __init__(self) -> None:
        self._newest_ms: int | None = None

    def read(self, update: Update) -> Sequence[int | None]:
        """Return the time of each frame of the next message, ns, or None if the watch sends no times."""
        deltas = [frame.delta_ms if 0 < frame.delta_ms <= MAX_DELTA_MS else 0 for frame in update.frames]
        if not deltas:
            return ()

        # Time of the last frame
        previous_ms = self._newest_ms
        if 0 < update.unix_ms < MAX_UNIX_MS:
            last_ms = update.unix_ms
        else:
            span_ms = sum(deltas)
            if not span_ms and 0 < update.delta_ms <= MAX_DELTA_MS:
                span_ms = update.delta_ms
            if not span_ms:
                return (None,) * len(deltas)
            last_ms = (previous_ms or 0) + span_ms
        self._newest_ms = last_ms

        # A time of the message before is not reached again, unless the clock was set back.
        first_ms = 0
        if previous_ms is not None and previous_ms <= last_ms:
            first_ms = previous_ms
        times_ns: list[int] = []
        for index in range(len(deltas)):
            time_ms = last_ms - sum(deltas[index + 1 :])
            times_ns.append(max(time_ms, first_ms) * NS_PER_MS)
        return times_ns


class SwipeDetector:
    """Detects swipes of one finger to the right or left."""

    def __init__(self) -> None:
        self.width_px = USUAL_WIDTH_PX
        self._began_px: tuple[float, float] | None = None

    def step(self, event: TouchEvent) -> int:
        """Return 1 if `event` ends a swipe to the right, -1 if to the left, else 0."""
        if event.kind == BEGIN:
            self._began_px = event.coordinates_px[0] if len(event.coordinates_px) == 1 else None
            return 0
        if len(event.coordinates_px) > 1 or event.kind == CANCEL:
            self._began_px = None
            return 0
        began_px = self._began_px
        if event.kind != END or began_px is None:
            return 0
        if not event.coordinates_px:
            return 0
        self._began_px = None
        ended_px = event.coordinates_px[0]
        right_px = ended_px[0] - began_px[0]
        down_px = ended_px[1] - began_px[1]
        min_right_px = max(MIN_SHARE * self.width_px, abs(down_px))
        if not abs(right_px) >= min_right_px:  # also if it is not a number
            return 0
        return 1 if right_px > 0.0 else -1


class TouchSdkConfig(BleConfig):
    """A watch with the Touch SDK app."""

    orientation: Literal["watch", "fusion"] = Field(
        default="watch",
        description="watch: the orientation that the watch computes; fusion: computed here from its angular "
        "velocity and acceleration, without magnetometer (extra `fusion`)",
    )
    hand: Literal["watch", "left", "right"] = Field(
        default="watch",
        description="wrist that wears it: as set on the watch, left or right; on the right one it is turned "
        "by 180°, so that the mounting plus_x fits both",
    )
    crown_sign: Literal[1, -1] = Field(
        default=1,
        description="1: the crown turned clockwise, by the sign of the maker's client, steps to the right; "
        "-1: to the left",
    )


def watch_id(advertisement: Advertisement) -> str:
    """Return the id of a watch, which stays while its address changes; the address if it sends none."""
    data = advertisement.manufacturer_data.get(ID_COMPANY, b"")
    identifier = data[:ID_LENGTH].decode("ascii", "replace")
    if len(identifier) == ID_LENGTH and identifier.isalnum():
        return identifier
    return advertisement.address


class TouchSdkWatch(Wrist):
    """The messages of a watch, and those to it."""

    kind = Kind(
        label="Touch SDK watch",
        plugin="touch_sdk",
        names=(),
        services=frozenset({touch_sdk_messages.ADVERTISED_SERVICE}),
        identify=watch_id,
        has_serial_number=False,
    )
    notifications = (touch_sdk_messages.OUTPUT,)

    def __init__(self, config: TouchSdkConfig, *, is_mounted_right: bool = False) -> None:
        """Create without a connection. `is_mounted_right`: the mounting is already that of a right wrist."""
        self._config = config
        self._is_mounted_right = is_mounted_right
        self._is_right = config.hand == "right"
        self._swipe = SwipeDetector()
        self.begin("")

    def begin(self, address: str) -> None:
        """Forget the connection before: the person may have withdrawn the approval."""
        del address
        self.is_ready = False
        self._times = FrameTimes()
        self._lacks_orientation = False
        self._unreadable: Counter[int] = Counter()
        """Number of unreadable messages by length."""

    @property
    def obstacle(self) -> Obstacle | None:
        """Obstacle while nothing arrives that can be used."""
        if self._unreadable.total() >= CUT:
            return _UNREADABLE
        if not self.is_ready:
            return _APPROVAL
        return _NO_ORIENTATION if self._lacks_orientation else _ASLEEP

    async def configure(self, connection: Connection) -> None:
        """Introduce this program, for which the person's approval is asked the first time."""
        info = touch_sdk_messages.encode_client_info("PointIt", this_machine().host_name, platform.system())
        try:
            async with asyncio.timeout(REPLY_S):
                await connection.write(touch_sdk_messages.INPUT, info)
        except Exception as error:  # of any system's radio
            if not connection.is_connected:
                raise
            log.debug("the introduction may have failed: %s", describe_error(error))

    def received(self, characteristic: str, data: bytes, stamp_ns: int) -> Iterable[WristItem]:
        """Return the items in a message."""
        del characteristic
        try:
            update = touch_sdk_messages.decode_update(data)
        except ValueError:
            return self._on_unreadable(len(data))
        if touch_sdk_messages.DISCONNECT in update.signals:
            return (self._refusal(),)
        self.is_ready = True
        return self._items(update, stamp_ns)

    async def ask(self, connection: Connection) -> Iterable[Item]:
        """Return the battery, after the hand was read."""
        try:
            async with asyncio.timeout(REPLY_S):
                data = await connection.read(touch_sdk_messages.OUTPUT)
                update = touch_sdk_messages.decode_update(data)
        except Exception as error:  # of any system's radio; readings go on without a description
            if not connection.is_connected:
                raise
            log.debug("the description of the watch cannot be read: %s", describe_error(error))
            return ()
        return () if update.info is None else self._read_info(update.info)

    def cue(self, feedback: Feedback) -> Sequence[tuple[float, bytes]]:
        """Return commands for the vibration."""
        pulses = vibration_pulses(feedback.haptic_ms)
        return [
            (pause_s, touch_sdk_messages.encode_haptic(VIBRATION, duration_ms))
            for pause_s, duration_ms in pulses
        ]

    async def play(self, connection: Connection, command: bytes) -> None:
        """Write one of them."""
        await connection.write(touch_sdk_messages.INPUT, command)

    def _items(self, update: Update, stamp_ns: int) -> Iterator[WristItem]:
        if update.info is not None:
            yield from self._read_info(update.info)
        for frame, time_ns in zip(update.frames, self._times.read(update), strict=True):
            reading = self._reading(frame, stamp_ns, time_ns)
            self._lacks_orientation = reading is None
            if reading is not None:
                yield reading
        for _ in range(update.gestures.count(touch_sdk_messages.PINCH)):
            yield Press(stamp_ns)
        steps = -self._config.crown_sign * sum(update.rotary_steps)  # as the maker's client turns the sign
        for _ in range(min(abs(steps), MAX_STEPS)):
            yield StepGesture(stamp_ns, 1 if steps > 0 else -1)
        for touch in update.touches:
            direction = self._swipe.step(touch)
            if direction:
                yield StepGesture(stamp_ns, 1 if direction > 0 else -1)

    def _reading(self, frame: SensorFrame, stamp_ns: int, time_ns: int | None) -> Reading | RawReading | None:
        turn = rotation.IDENTITY
        if self._is_right and not self._is_mounted_right:
            turn = _HALF_TURN
        if self._config.orientation == "fusion":
            rate_radps = frame.angular_velocity_radps
            acceleration_mps2 = frame.acceleration_mps2
            if not any(acceleration_mps2):
                return None
            if not all(map(math.isfinite, (*acceleration_mps2, *rate_radps))):
                return None
            rate_radps = rotation.rotate(turn, rate_radps)
            acceleration_mps2 = rotation.rotate(turn, acceleration_mps2)
            return RawReading(stamp_ns, rate_radps, acceleration_mps2, time_ns)
        try:
            orientation = unit_quaternion(frame.orientation_xyzw)
        except ValueError:
            return None
        return Reading(stamp_ns, rotation.multiply(orientation, turn), time_ns)

    def _read_info(self, info: WatchInfo) -> Iterator[Item]:
        if info.screen_width_px > 0.0:
            self._swipe.width_px = info.screen_width_px
        if 0 < info.battery_percent <= 100:  # an empty watch is off: 0 is one that does not state its charge
            yield Battery(info.battery_percent / 100.0)
        if self._config.hand != "watch":
            return
        if info.hand not in (touch_sdk_messages.LEFT, touch_sdk_messages.RIGHT):
            return
        is_right = info.hand == touch_sdk_messages.RIGHT
        if is_right != self._is_right:
            self._is_right = is_right
            yield Reconnected(keeps_yaw=False)  # readings are turned from now on

    def _on_unreadable(self, length: int) -> Iterable[LinkError]:
        self._unreadable[length] += 1
        if self._unreadable[length] < CUT:
            return ()
        return (
            LinkError(
                f"sends messages that are cut at {length} bytes, the limit of this connection: raise this "
                "machine's limit (Linux: ExchangeMTU in /etc/bluetooth/main.conf, at least 247), or use "
                "another Bluetooth adapter"
            ),
        )

    def _refusal(self) -> LinkError:
        if self.is_ready:
            return LinkError(
                "has ended the connection: its app was closed, or this machine was removed there; open the "
                "app on the watch",
                pause_s=ENDED_S,
            )
        return LinkError(
            "has declined the connection: confirm it on the watch when it asks again", pause_s=DECLINED_S
        )


def _make(config: TouchSdkConfig, surroundings: Surroundings) -> BleSource:
    mounting = rotation.rotate(surroundings.sensor_from_arm, (1.0, 0.0, 0.0))
    watch = TouchSdkWatch(config, is_mounted_right=mounting[0] < -0.5)
    return BleSource(watch, config, surroundings.clock, surroundings.health)


TOUCH_SDK = ImuSource(
    summary="a watch with Wear OS and the Touch SDK app, by Bluetooth",
    config=TouchSdkConfig,
    make=_make,
    check=lambda _config: require_bleak("touch_sdk"),
    argument="sensor",
    argument_optional=True,
    discover=discover_ble(TouchSdkWatch.kind),
)
