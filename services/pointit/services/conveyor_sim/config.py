"""Parameters of the simulated conveyor."""

from typing import Literal

from pydantic import Field

from pointit.runtime.config import Config


class FeederConfig(Config):
    """What is put on the lanes, and when."""

    sequence: tuple[str, ...] = Field(
        default=("red", "green", "blue"),
        description="kinds of the objects fed, in this order, over and over; empty: none are fed",
    )
    interval_s: float = Field(default=2.0, gt=0, le=3600, description="from one object to the next, s")
    length_m: float = Field(default=0.3, gt=0, le=5, description="length of the objects fed, m")
    count: int = Field(
        default=0, ge=0, description="objects fed in all, initial ones included; 0: without end"
    )
    initial: int = Field(
        default=0, ge=0, le=10_000, description="objects that are there at the start, evenly spaced"
    )


class ConveyorSimConfig(Config):
    """Which lines of the map are lanes, how fast they move, what is fed."""

    surface: Literal["strip", "belt"] = Field(
        default="belt", description="belt: the map's belts; strip: its LED strips taken as belts"
    )
    lanes: tuple[str, ...] = Field(
        default=(), description="ids of the belts or strips in the map; empty: all of them"
    )
    speed_mps: float = Field(
        default=0.5, ge=-5, le=5, description="speed at the start, m/s; negative: towards the lines' starts"
    )
    rate_hz: float = Field(default=25.0, gt=0, le=200, description="how often objects are reported, Hz")
    feeder: FeederConfig = Field(default=FeederConfig(), description="what is put on the lanes, and when")
