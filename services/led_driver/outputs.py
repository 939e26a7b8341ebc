"""Controllers of LED strips by name, also of installed packages: roles and the guard of each.

No core: it opens controllers and guards plug-ins.
"""

import functools
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, cast, runtime_checkable

from pydantic import Field, field_validator

from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import DevicePlugin, PluginGroup
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.plugin_guard import PluginGuard, Surroundings, WarningSink, guard_of
from pointit.schemas import Cursor, Environment, Lamp, Strip, StripsFrame
from pointit.schemas.base import Rgb

NONE = "none"
"""Kind of an output that is configured, but not used."""
FRAME_RATE = "frame rate"
"""First words of the name of the metric of an output's frames per second, before its address."""
LARGEST_OFFSET = 65535


@runtime_checkable
class Output(Protocol):
    """A controller of strips that is connected."""

    @property
    def light_s(self) -> float:
        """Return the time from `show` to the last byte on the wire, of the last new frame, s, or 0.0."""
        ...

    def set_strips(self, strips: Sequence[Strip]) -> None:
        """Set the map's strips."""
        ...

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        """Send `frame`, which shows what was captured `age_s` ago. Returns at once.

        It has the strips of `OutputConfig.strip_ids`, all of the map's if empty, and comes when one of them
        has changed. A device that needs more frames gets them from `run`.
        """
        ...

    async def run(self) -> None:
        """Send until cancelled, then switch the strips off."""
        ...


@runtime_checkable
class LampOutput(Protocol):
    """A connection to single lamps, such as smart lamps."""

    def set_lamps(self, lamps: Sequence[Lamp]) -> None:
        """Set the map's lamps."""
        ...

    def show_lamp(self, lamp_id: str, color: Rgb) -> None:
        """Show `color` on the lamp `lamp_id`, which may be none of the map's. Returns at once."""
        ...

    async def run(self) -> None:
        """Send until cancelled, then switch the lamps off."""
        ...


@runtime_checkable
class BeamOutput(Protocol):
    """A light whose beam follows a cursor on any surface, such as a moving head."""

    def set_map(self, environment: Environment) -> None:
        """Set the map."""
        ...

    def show_cursor(self, user: str, cursor: Cursor | None, color: Rgb) -> None:
        """Point at the `cursor` of `user` in their `color`. Returns at once.

        A cursor without a point hits nothing. None: no cursor has come for `led-driver.cursor_timeout_s`.
        """
        ...

    async def run(self) -> None:
        """Send until cancelled, then switch the beam off."""
        ...


AnyOutput = Output | LampOutput | BeamOutput


class GuardedOutput:
    """An output whose faults are reported and cost the others nothing. If it fails, a new one is made.

    It has every role. Calls of a role that its output has not are without effect.
    """

    def __init__(
        self, make: Callable[[], AnyOutput], guard: PluginGuard, strip_ids: Collection[str] = ()
    ) -> None:
        """Make the output.

        Args:
            make: creates the output, and creates it again after a failure.
            guard: reports errors of the output.
            strip_ids: strips of a frame that it gets. Empty: all of them.

        Raises:
            ConfigError: If it cannot be made.
        """
        self._make = make
        self._guard = guard
        self._strip_ids = strip_ids
        self._last_frame: StripsFrame | None = None
        """Its part of the last frame, or None if the next one is shown whatever is in it."""
        self._map: Environment | None = None
        self._colors: dict[str, Rgb] = {}
        """Colours of lamps."""
        self._set_output(guard.made(make))
        self._is_new = True

    def _set_output(self, output: AnyOutput) -> None:
        self._output = output
        # looks at the property, and a broken output's may raise anything
        self._strips = self._guard.call("light_s", lambda: output if isinstance(output, Output) else None)
        self._lamps = output if isinstance(output, LampOutput) else None
        self._beam = output if isinstance(output, BeamOutput) else None

    @property
    def light_s(self) -> float:
        """Return the time from `show` to the last byte on the wire, s, or 0.0."""
        output = self._strips
        if output is None:
            return 0.0
        light_s = self._guard.call("light_s", lambda: float(output.light_s))
        return light_s or 0.0

    @property
    def follows_cursors(self) -> bool:
        """True if it has a beam."""
        return self._beam is not None

    def set_map(self, environment: Environment) -> None:
        """Set the map, with its strips and lamps."""
        self._map = environment
        self._last_frame = None
        lamp_ids = {lamp.id for lamp in environment.lamps}
        self._colors = {lamp_id: color for lamp_id, color in self._colors.items() if lamp_id in lamp_ids}

        # Each role gets its part. One that raises does not keep the others from theirs
        strips = self._strips
        if strips is not None:
            self._guard.call("set_strips", lambda: strips.set_strips(environment.strips))
        lamps = self._lamps
        if lamps is not None:
            self._guard.call("set_lamps", lambda: lamps.set_lamps(environment.lamps))
        beam = self._beam
        if beam is not None:
            self._guard.call("set_map", lambda: beam.set_map(environment))

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> bool:
        """Send the output's part of `frame`, which shows what was captured `age_s` ago, if it has changed.

        Returns:
            True if it was sent.
        """
        output = self._strips
        if output is None:
            return False
        own = frame.strips
        if self._strip_ids:
            own = tuple(strip for strip in frame.strips if strip.id in self._strip_ids)
        if self._last_frame is not None and self._last_frame.strips == own:
            return False
        part = frame
        if own is not frame.strips:
            part = frame.model_copy(update={"strips": own})

        def send() -> bool:
            output.show(part, age_s)
            self._last_frame = part  # not if it raised, so that the next frame is another attempt
            return True

        return self._guard.call("show", send) or False

    def show_lamp(self, lamp_id: str, color: Rgb) -> None:
        """Show `color` on the lamp `lamp_id`."""
        output = self._lamps
        if output is not None:
            self._colors[lamp_id] = color
            self._guard.call("show_lamp", lambda: output.show_lamp(lamp_id, color))

    def show_cursor(self, user: str, cursor: Cursor | None, color: Rgb) -> None:
        """Point at the `cursor` of `user` in their `color`, or at none."""
        output = self._beam
        if output is not None:
            self._guard.call("show_cursor", lambda: output.show_cursor(user, cursor, color))

    async def run(self) -> None:
        """Send until cancelled."""
        await self._guard.keep_running(self._run)

    async def _run(self) -> None:
        # After a failure: a new output, which gets all that the failed one had been shown. The map goes first
        # and resets the last frame, which is therefore kept
        if not self._is_new:
            self._set_output(self._make())
            colors = self._colors
            last_frame = self._last_frame
            if self._map is not None:
                self.set_map(self._map)
            if last_frame is not None:
                self.show(last_frame)
            for lamp_id, color in colors.items():
                self.show_lamp(lamp_id, color)
        self._is_new = False
        await self._output.run()


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
        widths = {len(segment.order) for segment in segments}
        if len(widths) > 1:
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
    """A kind of controller that shows what PointIt draws: on strips, on single lamps or with a beam of light.

    It is a plug-in: one object that says what the controller is, which parameters it has, and how an output
    is made from their values. The output gets the newest frame and sends it; it never sees cursors or people.
    Its `argument` is its address, which no two outputs share; see `divided_by`. `UdpOutput` and
    `SerialOutput` do all of it but the bytes of a protocol.
    """

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
    used: set[tuple[str, str]] = set()
    counts = Counter(config.kind for config in configs)
    numbers_of_kind = Counter[str]()
    for number, config in enumerate(configs):
        if config.kind == NONE:
            continue
        kind = config.kind
        plugin = OUTPUTS.get(kind)
        numbers_of_kind[kind] += 1

        # The address distinguishes outputs of a kind, or their number if the kind has none
        if plugin.argument:
            parameter = f"outputs.{number}.{plugin.argument}"
            identity = _address(config, plugin, parameter)
            if (kind, identity) in used:
                remedy = "remove one"
                if plugin.divided_by:
                    remedy += f", or correct its `{plugin.divided_by}`"
                raise ConfigError(f"{parameter}: {identity} is used by two outputs: {remedy}")
            used.add((kind, identity))
            name = identity
        else:
            number_of_kind = numbers_of_kind[kind]
            identity = str(number_of_kind) if number_of_kind > 1 else ""
            name = f"outputs.{number}"

        # Health names an output only where its kind is not enough
        if counts[kind] == 1:
            name = ""
        plugin_surroundings = surroundings(OUTPUTS.kind, kind, "", identity)
        guard = guard_of(OUTPUTS, kind, health, name)
        make = functools.partial(plugin.make, config, plugin_surroundings)
        outputs.append(GuardedOutput(make, guard, config.strip_ids()))
    return outputs


def _address(config: OutputConfig, plugin: LedOutput, parameter: str) -> str:
    """Return the address of an output, with the parameter that divides it.

    Raises:
        ConfigError: If the address, which `parameter` has, is missing.
    """
    address = str(getattr(config, plugin.argument))
    if not address:
        raise ConfigError(f"{parameter}: is missing; `--output {config.kind}:{plugin.example}` sets it")
    if plugin.divided_by:
        part = getattr(config, plugin.divided_by)
        address += f" {plugin.divided_by} {part}"
    return address
