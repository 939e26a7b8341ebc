"""Controllers of LED strips by name: ours, and those of installed packages."""

import functools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self, cast

from pydantic import Field, field_validator, model_validator

from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import Plugin, PluginGroup
from pointit.runtime.errors import ConfigError
from pointit.runtime.health.service_bus import WarningSink
from pointit.runtime.health.surroundings import Surroundings
from pointit.runtime.service.plugin_guard import PluginGuard, guard_of
from pointit.schemas import Strip, StripsFrame

NONE = "none"
"""Kind of an output that is configured, but not used."""


class ChannelConfig(Config):
    """Connection of a strip to its controller."""

    channel: int = Field(ge=0, le=63, description="board number (0-7) times 8 plus port (0-7)")
    order: str = Field(
        default="GRB",
        description="order of the colours on the LEDs' wire: GRB, RGB, GRBW ...",
    )

    @field_validator("order")
    @classmethod
    def _each_once(cls, order: str) -> str:
        if "".join(sorted(order)) not in ("BGR", "BGRW"):
            raise ValueError("use each of R, G, B once, and W once if the LEDs have white")
        return order


class OutputConfig(Config):
    """Parameters of every kind of controller."""

    kind: str = Field(default=NONE, description="kind of controller (`pointit list plugins`), or none")
    gamma: float = Field(
        default=2.2,
        ge=1,
        le=4,
        description="exponent of the gamma correction of LED values; 1: no correction",
    )
    current_per_pixel_ma: float = Field(
        default=60.0, gt=0, le=1000, description="current of one white pixel, mA"
    )
    max_current_a: float | None = Field(
        default=None, gt=0, le=1000, description="limit above which frames are dimmed, A; no limit if empty"
    )
    channels: dict[str, ChannelConfig] = Field(
        default={},
        description="connections by strip id; strips in the map's order on channels 0, 1, 2 ... if empty",
    )

    @model_validator(mode="after")
    def _one_strip_a_channel(self) -> Self:
        taken: dict[int, str] = {}
        for strip_id, channel in self.channels.items():
            other = taken.setdefault(channel.channel, strip_id)
            if other != strip_id:
                raise ValueError(
                    f"channels: strips {other!r} and {strip_id!r} share channel {channel.channel}"
                )
        return self


class UnusedOutput(OutputConfig, extra="ignore"):
    """An output of kind `none`, whose parameters may be those of any kind."""


class Output(Protocol):
    """A controller that is connected."""

    @property
    def light_s(self) -> float:
        """Return the time from `show` to the last byte on the wire, of the last new frame, s, or 0.0."""
        ...

    def set_strips(self, strips: Sequence[Strip]) -> None:
        """Set the map's strips."""
        ...

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        """Send `frame`, which shows what was captured `age_s` ago. Returns at once."""
        ...

    async def run(self) -> None:
        """Send until cancelled, then switch the strips off."""
        ...


@dataclass(frozen=True, kw_only=True)
class LedOutput(Plugin):
    """A kind of controller. Its `argument` is its address, which no two outputs share."""

    make: Callable[[Any, Surroundings], Output]
    """Makes an output with parameters of the class `config`, an `OutputConfig`; opens nothing yet."""


OUTPUTS = PluginGroup("pointit.led_outputs", LedOutput, "LED output")


class GuardedOutput:
    """An output whose faults are reported and cost the others nothing. If it fails, a new one is made."""

    def __init__(self, make: Callable[[], Output], guard: PluginGuard) -> None:
        """Make the output.

        Raises:
            ConfigError: If it cannot be made.
        """
        self._make = make
        self._guard = guard
        self._strips: Sequence[Strip] = ()
        self._output = guard.made(make)
        self._is_new = True

    @property
    def light_s(self) -> float:
        """Return the time from `show` to the last byte on the wire, s."""
        return self._guard.call("light_s", lambda: float(self._output.light_s)) or 0.0

    def set_strips(self, strips: Sequence[Strip]) -> None:
        """Set the map's strips."""
        self._strips = strips
        self._guard.call("set_strips", lambda: self._output.set_strips(strips))

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        """Send `frame`, which shows what was captured `age_s` ago."""
        self._guard.call("show", lambda: self._output.show(frame, age_s))

    async def run(self) -> None:
        """Send until cancelled."""
        await self._guard.keep_running(self._run)

    async def _run(self) -> None:
        if not self._is_new:
            self._output = self._make()
            self._output.set_strips(self._strips)
        self._is_new = False
        await self._output.run()


def validate_output(value: object) -> object:
    """Return the parameters of an output as those of its kind, where `value` is a mapping.

    Raises:
        ValueError: The kind is not installed, or a parameter is wrong.
    """
    if not isinstance(value, Mapping):
        return value
    values = cast("Mapping[str, object]", value)
    kind = str(values.get("kind", NONE))
    if kind == NONE:
        return UnusedOutput.model_validate(values)
    if kind not in OUTPUTS.names:
        raise ValueError(f"kind: use one of {', '.join((NONE, *OUTPUTS.names))}")
    return OUTPUTS.validate(kind, values)


def make_outputs(
    configs: Sequence[OutputConfig],
    surroundings: Callable[[str, str, str, str], Surroundings],
    health: WarningSink,
) -> list[Output]:
    """Return the outputs that `configs` describe, none of them open yet.

    Args:
        configs: parameters of each output.
        surroundings: returns what the plug-in of a kind and a name may use, for a person and by what
            distinguishes it from others of that name.
        health: names outputs that fail.

    Raises:
        ConfigError: If an address is missing or used twice.
    """
    made: list[Output] = []
    taken: set[tuple[str, str]] = set()
    uses = Counter(config.kind for config in configs)
    seen = Counter[str]()
    for number, config in enumerate(configs):
        if config.kind == NONE:
            continue
        plugin = OUTPUTS.get(config.kind)
        seen[config.kind] += 1
        which = str(seen[config.kind]) if seen[config.kind] > 1 else ""
        if plugin.argument:
            address = str(getattr(config, plugin.argument))
            where = f"outputs.{number}.{plugin.argument}"
            if not address:
                raise ConfigError(f"{where}: is missing; `--leds {config.kind}:{plugin.example}` sets it")
            if (config.kind, address) in taken:
                raise ConfigError(f"{where}: {address} is used by two outputs: remove one")
            taken.add((config.kind, address))
            which = address
        around = surroundings(OUTPUTS.kind, config.kind, "", which)
        told = (which if plugin.argument else f"outputs.{number}") if uses[config.kind] > 1 else ""
        guard = guard_of(OUTPUTS, config.kind, health, told)
        made.append(GuardedOutput(functools.partial(plugin.make, config, around), guard))
    return made
