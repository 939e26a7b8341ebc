"""What is stored of the set-up of a home."""

import math
from typing import Literal

from pydantic import BaseModel, ConfigDict

from pointit.geometry.vector import Vec3
from pointit.scan.paced_model import FIRST
from pointit.schemas.home import LAMP, STRIP, HomeHand, HomeKind, HomeStep

End = Literal["", "first", "last"]


class _Stored(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ChosenLamp(_Stored):
    """A lamp that people want to point at; `id` as in `HomeLamp`."""

    id: str
    label: str = ""
    area: str = ""
    kind: HomeKind = "lamp"

    @property
    def ends(self) -> tuple[End, ...]:
        """Return the ends that are pointed at: two of a strip."""
        return ("first", "last") if self.id.startswith(STRIP) else ("",)


class LampPress(_Stored):
    """A press of a person who pointed at a lamp, or at an end of a strip.

    Its azimuth is that at the first place, where the map's x axis is that of the device's yaw 0 then.
    """

    lamp: str
    end: End
    place: Literal["A", "B"]
    azimuth_rad: float
    elevation_rad: float
    eyes_m: float
    reach_rad: float | None = None
    """Angle from the press before, or None if that is not known."""
    spread_rad: float = 0.0
    """Rms angle of its rays around their mean."""
    zero: int = 0
    """Number of the zero of the device's yaw. Presses with the same one share its error."""

    @property
    def target(self) -> tuple[str, End]:
        """Return the lamp and its end."""
        return self.lamp, self.end

    @property
    def direction(self) -> Vec3:
        """Return the unit vector to which it points."""
        level = math.cos(self.elevation_rad)
        return (
            level * math.cos(self.azimuth_rad),
            level * math.sin(self.azimuth_rad),
            math.sin(self.elevation_rad),
        )


class PlacedLamp(_Stored):
    """Position of a lamp or of an end of a strip, and the standard deviation of the angle to it."""

    lamp: str
    end: End
    position_m: Vec3
    direction_sigma_rad: float
    is_unsure: bool = False
    """The presses cannot tell that they are not exchanged with those of another lamp."""


class UsedSecret(_Stored):
    """Address to which a token or password was sent, and the time (ns) at which its file was written."""

    url: str
    written_ns: int
    replacement: str = ""
    """Name as in `AddressTrial` of the one that replaces the file, `""` once it has."""


class AddressTrial(_Stored):
    """An address that nobody has accepted yet."""

    url: str
    secret: str = ""
    """Name as in `SetUpHome` of the token or password that was given with it, `""` for the stored one."""


class StoredSetup(_Stored):
    """The set-up of a home as it is stored."""

    step: HomeStep = "connect"
    url: str = ""
    """Address that was accepted last."""
    trial: AddressTrial | None = None
    has_home: bool = True
    """False if the person has said that there is no Home Assistant."""
    secrets: dict[str, UsedSecret] = {}
    """Use of each file with a token or password, by its name."""
    offered: tuple[str, ...] = ()
    """Ids of all lamps that there were when some were chosen."""
    lamps: tuple[ChosenLamp, ...] = ()
    hand: HomeHand = ""
    user: str = ""
    place: Literal["A", "B"] = FIRST
    has_one_place: bool = False
    presses: tuple[LampPress, ...] = ()
    repeated: tuple[tuple[str, End], ...] = ()
    """Targets that were pointed at once more, since their presses contradicted the others."""
    dropped: tuple[LampPress, ...] = ()
    """Presses that were made once more since then: if the new ones agree, the other place was wrong."""
    is_short_walk: bool = False
    """The presses say that the person has hardly walked, and nothing is decided yet."""
    zero: int = 0
    """`LampPress.zero` of the next press."""
    left_out: dict[str, str] = {}
    """Lamps that are not placed, with the reason."""
    turn_rad: float = 0.0
    """Azimuth at the first place of the device's yaw 0 as it is now."""
    placed: tuple[PlacedLamp, ...] = ()
    met: tuple[str, ...] = ()
    """Lamps that have reacted when they were meant, since they were placed."""
    aside: tuple[str, ...] = ()
    """Placed lamps that the person does not try."""
    places_m: tuple[tuple[float, float], ...] = ()
    drift_rad: float = 0.0


def is_of_map(lamp: str) -> bool:
    """Return True if a lamp is a light of the map, and no entity of a home."""
    return lamp.startswith((STRIP, LAMP))
