"""Roles of outputs: strips, single lamps, a beam. An output has one or several."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from pointit.schemas import Cursor, Environment, Lamp, Strip, StripsFrame
from pointit.schemas.base import Rgb


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
