"""Guard of an output of any role."""

from collections.abc import Callable, Collection

from pointit.runtime.service.plugin_guard import PluginGuard
from pointit.schemas import Cursor, Environment, StripsFrame
from pointit.schemas.base import Rgb
from pointit.services.led_driver.roles import AnyOutput, BeamOutput, LampOutput, Output


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
        self._use(guard.made(make))
        self._is_new = True

    def _use(self, output: AnyOutput) -> None:
        self._output = output
        # looks at the property, and a broken output's may raise anything
        self._strips = self._guard.call("light_s", lambda: output if isinstance(output, Output) else None)
        self._lamps = output if isinstance(output, LampOutput) else None
        self._beam = output if isinstance(output, BeamOutput) else None

    @property
    def light_s(self) -> float:
        """Return the time from `show` to the last byte on the wire, s, or 0.0."""
        if (output := self._strips) is None:
            return 0.0
        return self._guard.call("light_s", lambda: float(output.light_s)) or 0.0

    @property
    def follows_cursors(self) -> bool:
        """True if it has a beam."""
        return self._beam is not None

    def set_map(self, environment: Environment) -> None:
        """Set the map, with its strips and lamps."""
        self._map = environment
        self._last_frame = None
        lamps = {lamp.id for lamp in environment.lamps}
        self._colors = {lamp_id: color for lamp_id, color in self._colors.items() if lamp_id in lamps}
        if (strips := self._strips) is not None:
            self._guard.call("set_strips", lambda: strips.set_strips(environment.strips))
        if (lamps_output := self._lamps) is not None:
            self._guard.call("set_lamps", lambda: lamps_output.set_lamps(environment.lamps))
        if (beam := self._beam) is not None:
            self._guard.call("set_map", lambda: beam.set_map(environment))

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> bool:
        """Send the output's part of `frame`, which shows what was captured `age_s` ago, if it has changed.

        Returns:
            True if it was sent.
        """
        if (output := self._strips) is None:
            return False
        if self._strip_ids:
            own = tuple(strip for strip in frame.strips if strip.id in self._strip_ids)
        else:
            own = frame.strips
        if self._last_frame is not None and self._last_frame.strips == own:
            return False
        part = frame if own is frame.strips else frame.model_copy(update={"strips": own})

        def send() -> bool:
            output.show(part, age_s)
            self._last_frame = part  # not if it raised, so that the next frame is another attempt
            return True

        return self._guard.call("show", send) or False

    def show_lamp(self, lamp_id: str, color: Rgb) -> None:
        """Show `color` on the lamp `lamp_id`."""
        if (output := self._lamps) is not None:
            self._colors[lamp_id] = color
            self._guard.call("show_lamp", lambda: output.show_lamp(lamp_id, color))

    def show_cursor(self, user: str, cursor: Cursor | None, color: Rgb) -> None:
        """Point at the `cursor` of `user` in their `color`, or at none."""
        if (output := self._beam) is not None:
            self._guard.call("show_cursor", lambda: output.show_cursor(user, cursor, color))

    async def run(self) -> None:
        """Send until cancelled."""
        await self._guard.keep_running(self._run)

    async def _run(self) -> None:
        if not self._is_new:
            self._use(self._make())
            colors, shown = self._colors, self._last_frame
            if self._map is not None:
                self.set_map(self._map)
            if shown is not None:
                self.show(shown)
            for lamp_id, color in colors.items():
                self.show_lamp(lamp_id, color)
        self._is_new = False
        await self._output.run()
