"""Controllers of LED strips by name: ours, and those of installed packages."""

import functools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from pydantic import Field, field_validator

from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import DevicePlugin, PluginGroup
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.plugin_guard import guard_of
from pointit.runtime.service.surroundings import Surroundings, WarningSink
from pointit.services.led_driver.guarded_output import GuardedOutput
from pointit.services.led_driver.roles import AnyOutput

NONE = "none"
"""Kind of an output that is configured, but not used."""
FRAME_RATE = "frame rate"
"""First words of the name of the metric of an output's frames per second, before its address."""
LARGEST_OFFSET = 65535


def validated_order(order: str) -> str:
    """Return `order` if it names each of R, G, B once, and W at most once. Raises ValueError otherwise."""
    if "".join(sorted(order)) not in ("BGR", "BGRW"):
        raise ValueError("use each of R, G, B once, and W once if the LEDs have white")
    return order


class Segment(Config):
    """A part of a strip, on consecutive pixels of an output."""

    strip: str = Field(description="id of the strip in the map")
    first: int = Field(default=0, ge=0, description="first pixel of the strip")
    pixels: int | None = Field(
        default=None, gt=0, description="number of pixels; up to the strip's end if empty"
    )
    offset: int | None = Field(
        default=None,
        ge=0,
        le=LARGEST_OFFSET,
        description="first pixel of the output, or of `universe` if set; next to the segment before if empty",
    )
    universe: int | None = Field(
        default=None, ge=0, le=63999, description="universe from which `offset` counts (E1.31, Art-Net)"
    )
    order: str = Field(
        default="RGB", description="order of the colours that are sent: RGB, GRB, RGBW ...; W stays dark"
    )
    reversed: bool = Field(default=False, description="send the last pixel first")

    _order = field_validator("order")(validated_order)


class OutputConfig(Config):
    """Parameters of every kind of controller."""

    kind: str = Field(default=NONE, description="kind of controller (`pointit plugin list`), or none")
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
    segments: tuple[Segment, ...] = Field(
        default=(),
        description="parts of strips, in the order of their pixels; the map's strips in its order if empty",
    )

    @field_validator("segments")
    @classmethod
    def _equally_wide(cls, segments: tuple[Segment, ...]) -> tuple[Segment, ...]:
        if len({len(segment.order) for segment in segments}) > 1:
            raise ValueError(
                "three and four colours do not go together: use an output for each, at a universe of its own"
            )
        return segments

    def strip_ids(self) -> frozenset[str]:
        """Return the ids of the strips that it shows, empty for all of the map."""
        return frozenset(segment.strip for segment in self.segments)


class UnusedOutput(OutputConfig, extra="ignore"):
    """An output of kind `none`, whose parameters may be those of any kind."""


@dataclass(frozen=True, kw_only=True)
class LedOutput(DevicePlugin):
    """A kind of controller. Its `argument` is its address, which no two outputs share; see `divided_by`."""

    make: Callable[[Any, Surroundings], AnyOutput]
    """Makes an output with parameters of the class `config`, an `OutputConfig`; opens nothing yet."""
    divided_by: str = ""
    """Parameter that differs between outputs that share an address, such as `universe`. `""`: none does."""


OUTPUTS = PluginGroup("pointit.led_outputs", LedOutput, "LED output")


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
    OUTPUTS.check_name(kind, NONE)
    return OUTPUTS.validate(kind, values)


def make_outputs(
    configs: Sequence[OutputConfig],
    surroundings: Callable[[str, str, str, str], Surroundings],
    health: WarningSink,
) -> list[GuardedOutput]:
    """Return the outputs that `configs` describe, none of them open yet.

    Args:
        configs: parameters of each output.
        surroundings: returns what the plug-in of a kind and a name may use, for a person and by what
            distinguishes it from others of that name.
        health: names outputs that fail.

    Raises:
        ConfigError: If an address is missing or used twice.
    """
    outputs: list[GuardedOutput] = []
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
            which = str(getattr(config, plugin.argument))
            where = f"outputs.{number}.{plugin.argument}"
            if not which:
                raise ConfigError(f"{where}: is missing; `--output {config.kind}:{plugin.example}` sets it")
            remedy = "remove one"
            if plugin.divided_by:
                which += f" {plugin.divided_by} {getattr(config, plugin.divided_by)}"
                remedy += f", or correct its `{plugin.divided_by}`"
            if (config.kind, which) in taken:
                raise ConfigError(f"{where}: {which} is used by two outputs: {remedy}")
            taken.add((config.kind, which))
        around = surroundings(OUTPUTS.kind, config.kind, "", which)
        name = (which if plugin.argument else f"outputs.{number}") if uses[config.kind] > 1 else ""
        guard = guard_of(OUTPUTS, config.kind, health, name)
        make = functools.partial(plugin.make, config, around)
        outputs.append(GuardedOutput(make, guard, config.strip_ids()))
    return outputs
