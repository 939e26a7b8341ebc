"""Parameters of a moving head: where it is sent, how it hangs, what its channels do."""

import math
from collections import Counter
from typing import Literal, Self, cast

from pydantic import Field, field_validator, model_validator

from pointit.runtime.address_config import AddressConfig
from pointit.runtime.config.config import Config
from pointit.schemas.base import Vec3
from pointit.services.led_driver.output.dmx.artnet_protocol import MAX_PORT_ADDRESS
from pointit.services.led_driver.output.dmx.e131 import check_interface
from pointit.services.led_driver.output.dmx.e131_protocol import MAX_UNIVERSE, MIN_UNIVERSE
from pointit.services.led_driver.output.dmx.stream import UNIVERSE_SLOTS
from pointit.services.led_driver.output.spotlight.head import HeadLimits, HeadMounting
from pointit.services.led_driver.outputs import OutputConfig

LARGEST_RANGE_DEG = 1080.0


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
        each = (self.pan, self.pan_fine, self.tilt, self.tilt_fine)
        return [number for number in (*each, self.dimmer, self.red, self.green, self.blue) if number]

    @model_validator(mode="after")
    def _can_be_dark(self) -> Self:
        if not (self.dimmer or (self.red and self.green and self.blue)):
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
    position_m: Vec3 = Field(default=(0.0, 0.0, 3.0), description="place where pan and tilt axis cross")
    yaw_deg: float = Field(default=0.0, ge=-360, le=360, description="rotation about z, after the others")
    pitch_deg: float = Field(default=0.0, ge=-360, le=360, description="rotation about y, after roll")
    roll_deg: float = Field(default=180.0, ge=-360, le=360, description="rotation about x; 180: it hangs")
    user: str = Field(
        default="", description="person whom the beam follows; who began to point last if empty"
    )

    @field_validator("fixed_channels", mode="before")
    @classmethod
    def _are_different(cls, value: object) -> object:
        if not isinstance(value, dict):
            return value  # the field's type reports it
        channels = cast("dict[object, object]", value)
        numbers = Counter(str(key).strip().lstrip("+0") for key in channels)
        if twice := [number for number, uses in numbers.items() if uses > 1]:
            raise ValueError(f"channel {twice[0]} is there twice; keep one")
        return channels

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        check_interface(self.host, self.interface)
        lowest, highest = (MIN_UNIVERSE, MAX_UNIVERSE) if self.protocol == "e131" else (0, MAX_PORT_ADDRESS)
        if not lowest <= self.universe <= highest:
            raise ValueError(f"universe: {self.universe}; {self.protocol} has {lowest} to {highest}")
        numbers = [*self.channels.used, *self.fixed_channels]
        if twice := [number for number, uses in Counter(numbers).items() if uses > 1]:
            raise ValueError(f"channels: channel {twice[0]} is used twice")
        last = self.address + max(numbers) - 1
        if min(numbers) < 1 or last > UNIVERSE_SLOTS:
            raise ValueError(f"address: the fixture's channels reach {last}; they are 1 to {UNIVERSE_SLOTS}")
        if not all(0 <= value <= 255 for value in self.fixed_channels.values()):
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
