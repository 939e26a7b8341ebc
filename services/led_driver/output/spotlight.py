"""Output to a moving head whose beam follows the cursor of a user: how it hangs, its geometry and motion.

The fixture's frame {F} has its origin where both axes cross, and z along the pan axis from the base to the
head. At pan 0 and tilt 0, the middles of both ranges, the beam leaves along z. Tilt turns it about y, and pan
then about z.

Pure: calls pass the time.

No core: it sends datagrams at its own times.
"""

import asyncio
import math
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, Self

from pydantic import Field, model_validator

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.geometry.vector import Vec3
from pointit.runtime.address_config import AddressConfig
from pointit.runtime.config.config import Config
from pointit.runtime.service.plugin_guard import HealthSink
from pointit.schemas import Cursor, Environment
from pointit.schemas.base import Rgb
from pointit.schemas.base import Vec3 as ConfiguredVec3
from pointit.services.led_driver.output import artnet, e131
from pointit.services.led_driver.output.artnet import MAX_PORT_ADDRESS, ArtnetStream
from pointit.services.led_driver.output.e131 import MAX_UNIVERSE, MIN_UNIVERSE, E131Stream, check_interface
from pointit.services.led_driver.output.pixel_output import OutputHealth
from pointit.services.led_driver.output.udp_output import (
    RATE_HZ,
    UNIVERSE_SLOTS,
    Datagram,
    DatagramSender,
    Destination,
    DmxStream,
)
from pointit.services.led_driver.outputs import LedOutput, OutputConfig

POLE_RAD = 1e-6
"""Angle to the pan axis below which any pan will do."""
NEAREST_M = 1e-3
"""Distance from the fixture below which a point has no direction."""
LARGEST_STEP_RAD = math.radians(16.0)
SMALLEST_STEP_RAD = math.radians(0.0625)
FIRST_STEP_RAD = math.radians(4.0)
KEY = re.compile(rb"\x1b[\[O]([ABCD])|([-+=]|[ \r\n])")
"""An arrow as terminals send it, or another key in use."""
ARROWS = {b"A": (0, 1), b"B": (0, -1), b"C": (1, 0), b"D": (-1, 0)}
"""Steps of pan and tilt by up, down, right, left."""

LARGEST_RANGE_DEG = 1080.0

DARK: Rgb = (0, 0, 0)
FULL = 255


@dataclass(frozen=True, slots=True)
class Angles:
    """Angles of both axes from the middle of their range, rad."""

    pan_rad: float
    tilt_rad: float

    def mirrored(self) -> "Angles":
        """Return the angles of a head whose pan turns the other way round."""
        return Angles(-self.pan_rad, self.tilt_rad)


HOME = Angles(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class HeadLimits:
    """Range and speed of both axes."""

    pan_range_rad: float
    """Whole range, symmetric about 0."""
    tilt_range_rad: float
    pan_speed_radps: float
    tilt_speed_radps: float

    def allow(self, angles: Angles) -> bool:
        """Return True if the head can turn to `angles`."""
        allows_pan = abs(angles.pan_rad) <= self.pan_range_rad / 2.0
        allows_tilt = abs(angles.tilt_rad) <= self.tilt_range_rad / 2.0
        return allows_pan and allows_tilt

    def duration_s(self, start: Angles, end: Angles) -> float:
        """Return the time that the head takes from `start` to `end`, s."""
        pan_s = abs(end.pan_rad - start.pan_rad) / self.pan_speed_radps
        tilt_s = abs(end.tilt_rad - start.tilt_rad) / self.tilt_speed_radps
        return max(pan_s, tilt_s)


@dataclass(frozen=True, slots=True)
class HeadMounting:
    """Pose of the fixture in the room."""

    position_m: Vec3
    """Place where both axes cross, {W}."""
    world_from_fixture: Quaternion

    @staticmethod
    def from_degrees(position_m: Vec3, yaw_deg: float, pitch_deg: float, roll_deg: float) -> "HeadMounting":
        """Return the pose whose rotation is roll about x, then pitch about y, then yaw about z of {W}."""
        roll, pitch, yaw = map(math.radians, (roll_deg, pitch_deg, yaw_deg))
        return HeadMounting(position_m, rotation.from_roll_pitch_yaw(roll, pitch, yaw))

    def beam(self, angles: Angles) -> Vec3:
        """Return the direction of the beam at `angles`, {W}."""
        return rotation.rotate(self.world_from_fixture, direction(angles))

    def angles(self, point_m: Vec3, start: Angles, limits: HeadLimits) -> Angles | None:
        """Return the angles at which the beam meets `point_m`, those reached soonest from `start`.

        None if the point is out of range, or at the fixture itself.
        """
        offset = vector.subtract(point_m, self.position_m)
        if vector.norm(offset) < NEAREST_M:
            return None

        # Along the pan axis, any pan will do
        fixture_from_world = rotation.inverse(self.world_from_fixture)
        x, y, z = rotation.rotate(fixture_from_world, offset)
        level = math.hypot(x, y)
        tilt_rad = math.atan2(level, z)
        pan_rad = start.pan_rad if tilt_rad < POLE_RAD else math.atan2(y, x)

        # Each direction has two tilts of opposite signs, and each pan may be whole turns further
        choices: list[Angles] = []
        for opposite_pan_rad, signed_tilt_rad in ((pan_rad, tilt_rad), (pan_rad + math.pi, -tilt_rad)):
            for turned_pan_rad in _turns(opposite_pan_rad, limits.pan_range_rad):
                choice = Angles(turned_pan_rad, signed_tilt_rad)
                if limits.allow(choice):
                    choices.append(choice)
        return min(choices, key=lambda choice: limits.duration_s(start, choice), default=None)


def direction(angles: Angles) -> Vec3:
    """Return the direction of the beam at `angles`, {F}."""
    level = math.sin(angles.tilt_rad)
    x = level * math.cos(angles.pan_rad)
    y = level * math.sin(angles.pan_rad)
    return (x, y, math.cos(angles.tilt_rad))


def _turns(pan_rad: float, range_rad: float) -> Iterable[float]:
    """Return the angles equal to `pan_rad` but for whole turns, within the range."""
    first = math.ceil((-range_rad / 2.0 - pan_rad) / math.tau)
    last = math.floor((range_rad / 2.0 - pan_rad) / math.tau)
    return (pan_rad + turn * math.tau for turn in range(first, last + 1))


def moved(start: Angles, end: Angles, limits: HeadLimits, elapsed_s: float) -> Angles:
    """Return where the head is `elapsed_s` after `start` on its way to `end`.

    Both axes arrive together, so that the beam takes a smooth way.
    """
    duration_s = limits.duration_s(start, end)
    if duration_s <= elapsed_s:
        return end
    share = elapsed_s / duration_s
    pan_rad = start.pan_rad + share * (end.pan_rad - start.pan_rad)
    tilt_rad = start.tilt_rad + share * (end.tilt_rad - start.tilt_rad)
    return Angles(pan_rad, tilt_rad)


class ManualAim:
    """The angles, from home on, within the limits of the head."""

    def __init__(self, limits: HeadLimits) -> None:
        """Start at the home position."""
        self._limits = limits
        self.step_rad = FIRST_STEP_RAD
        """Angle of one step."""
        self.angles = HOME

    def press(self, data: bytes) -> int:
        """Turn by arrows, change the step by + and -. Return how often Enter or Space is in `data`."""
        entered = 0
        for arrow, key in KEY.findall(data):
            if arrow:
                self._turn(*ARROWS[arrow])
            elif key == b"-":
                self.step_rad = max(self.step_rad / 2.0, SMALLEST_STEP_RAD)
            elif key in b"+=":
                self.step_rad = min(self.step_rad * 2.0, LARGEST_STEP_RAD)
            else:
                entered += 1
        return entered

    def _turn(self, pan_steps: int, tilt_steps: int) -> None:
        pan_rad = self.angles.pan_rad + pan_steps * self.step_rad
        tilt_rad = self.angles.tilt_rad + tilt_steps * self.step_rad
        angles = Angles(pan_rad, tilt_rad)
        if self._limits.allow(angles):
            self.angles = angles


class ChannelMap(Config):
    """Channels of the fixture in the order of its manual, the first one is 1. 0: it has none."""

    pan: int = Field(default=1, ge=1, le=UNIVERSE_SLOTS, description="pan")
    pan_fine: int = Field(default=2, ge=0, le=UNIVERSE_SLOTS, description="low byte of pan, or 0")
    tilt: int = Field(default=3, ge=1, le=UNIVERSE_SLOTS, description="tilt")
    tilt_fine: int = Field(default=4, ge=0, le=UNIVERSE_SLOTS, description="low byte of tilt, or 0")
    dimmer: int = Field(default=5, ge=0, le=UNIVERSE_SLOTS, description="dimmer, or 0")
    red: int = Field(default=6, ge=0, le=UNIVERSE_SLOTS, description="red, or 0")
    green: int = Field(default=7, ge=0, le=UNIVERSE_SLOTS, description="green, or 0")
    blue: int = Field(default=8, ge=0, le=UNIVERSE_SLOTS, description="blue, or 0")

    @property
    def used(self) -> list[int]:
        """Return the numbers of the channels that exist."""
        axes = (self.pan, self.pan_fine, self.tilt, self.tilt_fine)
        colors = (self.dimmer, self.red, self.green, self.blue)
        return [number for number in axes + colors if number]

    @model_validator(mode="after")
    def _can_be_dark(self) -> Self:
        has_all_colors = all((self.red, self.green, self.blue))
        if not self.dimmer and not has_all_colors:
            raise ValueError("give the channel of the dimmer, or those of red, green and blue")
        return self


class SpotlightConfig(AddressConfig, OutputConfig):
    """A moving head whose beam follows a cursor."""

    kind: str = Field(default="spotlight", description="kind of controller")
    host: str = Field(
        default="",
        description="name or address of the DMX node, HOST:PORT, or `multicast` (E1.31) for all of a network",
    )
    protocol: Literal["e131", "artnet"] = Field(default="e131", description="protocol of the node")
    port: int | None = Field(
        default=None, gt=0, le=65535, description="UDP port of the node; the protocol's if empty"
    )
    interface: str = Field(
        default="", description="IPv4 address of this machine in the network that gets the multicast"
    )
    universe: int = Field(
        default=1,
        ge=0,
        le=MAX_UNIVERSE,
        description="universe, which nothing else uses; Art-Net counts from 0",
    )
    address: int = Field(
        default=1, ge=1, le=UNIVERSE_SLOTS, description="DMX address of the fixture, its first channel"
    )
    channels: ChannelMap = Field(default=ChannelMap(), description="channels of the fixture")
    fixed_channels: dict[int, int] = Field(
        default={}, description="values of further channels by number, such as an open shutter"
    )
    pan_range_deg: float = Field(
        default=540.0, gt=0, le=LARGEST_RANGE_DEG, description="angle from the lowest to the highest pan"
    )
    tilt_range_deg: float = Field(
        default=270.0, gt=0, le=360, description="angle from the lowest to the highest tilt"
    )
    invert_pan: bool = Field(default=False, description="higher values turn clockwise, seen from the beam")
    pan_speed_degps: float = Field(default=180.0, gt=0, le=2000, description="maximum speed of pan, °/s")
    tilt_speed_degps: float = Field(default=120.0, gt=0, le=2000, description="maximum speed of tilt, °/s")
    dark_beyond_deg: float = Field(
        default=180.0,
        gt=0,
        le=180,
        description="angle from beam to cursor above which it is dark; 180: never",
    )
    position_m: ConfiguredVec3 = Field(
        default=(0.0, 0.0, 3.0), description="place where pan and tilt axis cross"
    )
    yaw_deg: float = Field(default=0.0, ge=-360, le=360, description="rotation about z, after the others")
    pitch_deg: float = Field(default=0.0, ge=-360, le=360, description="rotation about y, after roll")
    roll_deg: float = Field(default=180.0, ge=-360, le=360, description="rotation about x; 180: it hangs")
    user: str = Field(
        default="", description="person whom the beam follows; who began to point last if empty"
    )

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        check_interface(self.host, self.interface)
        lowest = 0
        highest = MAX_PORT_ADDRESS
        if self.protocol == "e131":
            lowest = MIN_UNIVERSE
            highest = MAX_UNIVERSE
        if not lowest <= self.universe <= highest:
            raise ValueError(f"universe: {self.universe}; {self.protocol} has {lowest} to {highest}")

        # Channels, those with fixed values too: each once, all in the universe
        numbers = [*self.channels.used, *self.fixed_channels]
        for number, uses in Counter(numbers).items():
            if uses > 1:
                raise ValueError(f"channels: channel {number} is used twice")
        last = self.address + max(numbers) - 1
        if min(numbers) < 1 or last > UNIVERSE_SLOTS:
            raise ValueError(f"address: the fixture's channels reach {last}; they are 1 to {UNIVERSE_SLOTS}")
        for value in self.fixed_channels.values():
            if not 0 <= value <= FULL:
                raise ValueError("fixed_channels: values are 0 to 255")
        return self

    @property
    def limits(self) -> HeadLimits:
        """Return range and speed of the axes."""
        return HeadLimits(
            pan_range_rad=math.radians(self.pan_range_deg),
            tilt_range_rad=math.radians(self.tilt_range_deg),
            pan_speed_radps=math.radians(self.pan_speed_degps),
            tilt_speed_radps=math.radians(self.tilt_speed_degps),
        )

    @property
    def mounting(self) -> HeadMounting:
        """Return the pose of the fixture."""
        return HeadMounting.from_degrees(self.position_m, self.yaw_deg, self.pitch_deg, self.roll_deg)


@dataclass(frozen=True, slots=True)
class BeamState:
    """Angles and colour of the fixture at one time."""

    angles: Angles
    color: Rgb
    """Colour of the beam; black if it is dark."""


class Beam:
    """Turns the head towards its target within range and speed."""

    def __init__(self, mounting: HeadMounting, limits: HeadLimits, dark_beyond_rad: float = math.pi) -> None:
        """Create a dark beam at home.

        Args:
            mounting: pose of the fixture.
            limits: range and speed of its axes.
            dark_beyond_rad: angle between beam and target above which the beam is dark; pi: never.
        """
        self._mounting = mounting
        self._limits = limits
        self._dark_beyond_rad = dark_beyond_rad
        self._angles = HOME
        self._end = HOME
        self._color = DARK
        self._at_s = 0.0
        self.in_reach = True
        """False if the head cannot turn to its target."""

    @property
    def moves(self) -> bool:
        """True if the head has not reached its target."""
        return self._angles != self._end

    def aim(self, point_m: Vec3 | None, color: Rgb, now_s: float) -> None:
        """Turn to `point_m` in {W} from `now_s` on, in `color`. Without a point: stop and be dark."""
        self._advance(now_s)
        end = None
        if point_m is not None:
            end = self._mounting.angles(point_m, self._angles, self._limits)
        self.in_reach = point_m is None or end is not None
        if end is None:
            self._end = self._angles
            self._color = DARK
        else:
            self._end = end
            self._color = color

    def state(self, now_s: float) -> BeamState:
        """Return angles and colour at `now_s`, which must not be before the last call's."""
        self._advance(now_s)
        beam = self._mounting.beam(self._angles)
        target = self._mounting.beam(self._end)
        is_far = vector.angle_between(beam, target) > self._dark_beyond_rad
        return BeamState(self._angles, DARK if is_far else self._color)

    def _advance(self, now_s: float) -> None:
        elapsed_s = max(now_s - self._at_s, 0.0)
        self._angles = moved(self._angles, self._end, self._limits, elapsed_s)
        self._at_s = now_s


class Fixture:
    """The channels of one fixture in its universe."""

    def __init__(self, config: SpotlightConfig) -> None:
        """Create with the fixture's channels."""
        self._config = config
        self._empty = bytearray(UNIVERSE_SLOTS)
        for number, value in config.fixed_channels.items():
            self._set(self._empty, number, value)

    def slots(self, state: BeamState) -> bytes:
        """Return all values of the universe."""
        config = self._config
        channels = self._config.channels
        slots = bytearray(self._empty)
        pan = _share(state.angles.pan_rad, config.pan_range_deg, inverted=config.invert_pan)
        tilt = _share(state.angles.tilt_rad, config.tilt_range_deg, inverted=False)
        self._set_axis(slots, channels.pan, channels.pan_fine, pan)
        self._set_axis(slots, channels.tilt, channels.tilt_fine, tilt)
        brightness = 0 if state.color == DARK else FULL
        self._set(slots, channels.dimmer, brightness)
        red, green, blue = self._linear(state.color)
        self._set(slots, channels.red, red)
        self._set(slots, channels.green, green)
        self._set(slots, channels.blue, blue)
        return bytes(slots)

    def _set_axis(self, slots: bytearray, coarse: int, fine: int, share: float) -> None:
        if fine:
            high, low = divmod(round(share * 0xFFFF), 256)
            self._set(slots, coarse, high)
            self._set(slots, fine, low)
        else:
            self._set(slots, coarse, round(share * FULL))

    def _set(self, slots: bytearray, number: int, value: int) -> None:
        if number:
            slots[self._config.address + number - 2] = value

    def _linear(self, color: Rgb) -> Rgb:
        gamma = self._config.gamma
        red, green, blue = (round(FULL * (value / FULL) ** gamma) for value in color)
        return (red, green, blue)


def _share(angle_rad: float, range_deg: float, *, inverted: bool) -> float:
    """Return the share of an axis's range, 0 to 1, at an angle from its middle."""
    offset = angle_rad / math.radians(range_deg)
    share = 0.5 - offset if inverted else 0.5 + offset
    return min(max(share, 0.0), 1.0)


@dataclass(frozen=True, slots=True)
class BeamAim:
    """A person's cursor, which the beam may follow."""

    user: str
    point_m: Vec3
    """{W}."""
    color: Rgb


class BeamOwnership:
    """Cursors of the people who may have the beam."""

    def __init__(self, user: str = "") -> None:
        """Reserve the beam for `user`. `""`: for the user who started pointing last."""
        self._user = user
        self._aims: dict[str, BeamAim] = {}
        """In the order in which the people began to point."""

    def set_cursor(self, user: str, point_m: Vec3 | None, color: Rgb) -> None:
        """Set the place of `user`'s cursor. None: they point at nothing."""
        if self._user not in ("", user):
            return
        if point_m is None:
            self._aims.pop(user, None)
        else:
            self._aims[user] = BeamAim(user, point_m, color)

    @property
    def aim(self) -> BeamAim | None:
        """The cursor that the beam follows, or None if nobody points."""
        return next(reversed(self._aims.values()), None)


class DmxHead:
    """A moving head on its universe."""

    def __init__(self, config: SpotlightConfig, health: HealthSink) -> None:
        """Prepare; nothing is opened yet."""
        self._fixture = Fixture(config)
        self._universe = config.universe
        self._stream = _stream(config)
        self._angles = Angles(0.0, 0.0)
        self.health = OutputHealth(health, config.host)
        self._sender = DatagramSender(
            self._stream.destination,
            self._encode,
            self.health,
            max_rate_hz=RATE_HZ,
            encode_end=self._encode_end,
        )

    def send(self, state: BeamState) -> None:
        """Send the newest state."""
        self._angles = state.angles
        self._sender.send(self._fixture.slots(state))

    async def run(self) -> None:
        """Send until cancelled, then leave the head where it is, dark."""
        await self._sender.run()

    def _encode(self, slots: bytes, number: int) -> list[Datagram]:
        return self._stream.frame([(self._universe, slots)], number)

    def _encode_end(self, _slots: bytes, number: int) -> list[Datagram]:
        # a universe of zeros would turn the head to the end of its range
        dark = self._fixture.slots(BeamState(self._angles, DARK))
        return self._stream.end([(self._universe, dark)], number)


class Spotlight:
    """Turns a moving head to the cursor of the person who has the beam."""

    def __init__(self, config: SpotlightConfig, health: HealthSink) -> None:
        """Prepare; nothing is opened yet."""
        dark_beyond_rad = math.radians(config.dark_beyond_deg)
        self._beam = Beam(config.mounting, config.limits, dark_beyond_rad)
        self._ownership = BeamOwnership(config.user)
        self._head = DmxHead(config, health)
        self._changed = asyncio.Event()

    def set_map(self, environment: Environment) -> None:
        """Set the map, in which the fixture is not: its pose is configured."""

    def show_cursor(self, user: str, cursor: Cursor | None, color: Rgb) -> None:
        """Follow the `cursor` of `user` in their `color`, if they have the beam. Returns at once."""
        point_m = None if cursor is None else cursor.point_m
        self._ownership.set_cursor(user, point_m, color)

        # The beam follows the cursor that owns it, which may be another user's
        aim = self._ownership.aim
        now_s = asyncio.get_running_loop().time()
        if aim is None:
            self._beam.aim(None, DARK, now_s)
        else:
            self._beam.aim(aim.point_m, aim.color, now_s)
        self._changed.set()

        # Say why the beam is dark
        if aim is None or self._beam.in_reach:
            self._head.health.clear("reach")
        else:
            self._head.health.warn(
                "reach",
                f"the beam cannot reach the cursor of {aim.user}: mount it where it can, or correct its pose "
                "and its ranges of pan and tilt",
            )

    async def run(self) -> None:
        """Send until cancelled, then switch the beam off."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._head.run())
            group.create_task(self._follow())

    async def _follow(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            self._changed.clear()
            self._head.send(self._beam.state(loop.time()))
            if self._beam.moves:
                await asyncio.sleep(1.0 / RATE_HZ)
            else:
                await self._changed.wait()


def _stream(config: SpotlightConfig) -> DmxStream:
    if config.protocol == "artnet":
        return ArtnetStream(config.host, config.port or artnet.PORT)
    port = config.port or e131.PORT
    destination = Destination(host=config.host, port=port, interface=config.interface)
    return E131Stream(destination, config.universe)


SPOTLIGHT = LedOutput(
    summary="a moving head (E1.31, Art-Net) whose beam follows the cursor",
    config=SpotlightConfig,
    make=lambda config, surroundings: Spotlight(config, surroundings.health),
    argument="host",
    divided_by="universe",
    example="ADDRESS",
)
