"""Parameters of mocap."""

from typing import Literal

from pydantic import Field, model_validator

from pointit.runtime.config.config import Config
from pointit.schemas.base import Name

MAX_BODIES = 256
"""Number of bodies of a stream and of a configuration."""


class WornBodyConfig(Config):
    """Meaning of one rigid body."""

    kind: str = Field(
        default="object",
        max_length=64,
        description="kind of the object, `robot` for what people may steer by",
    )
    length_m: float = Field(default=0.1, gt=0, le=20, description="diameter of the object, m")
    person: Name | Literal[""] = Field(default="", description="person who wears it, or empty")
    part: Literal["head", "forearm"] = Field(
        default="head",
        description="place on the person. head: gives the position; forearm, of the arm with the "
        "IMU: gives the yaw",
    )

    @property
    def meaning(self) -> str:
        """Return the part of a person, or the kind of an object."""
        return f"{self.part} of {self.person}" if self.person else self.kind


class MocapConfig(Config):
    """A server of motion capture, and the meaning of its bodies."""

    system: Literal["natnet", "qtm"] = Field(
        default="natnet", description="natnet: OptiTrack Motive; qtm: Qualisys Track Manager"
    )
    server: str = Field(default="", max_length=253, description="name or address of the machine with it")
    port: int = Field(
        default=0,
        ge=0,
        le=65535,
        description="its port: UDP for commands of NatNet (0: 1510), TCP, little-endian, of QTM (0: 22223)",
    )
    interface: str = Field(
        default="",
        max_length=15,
        description="IPv4 address of this machine in the network of the cameras; if empty, the one that "
        "leads to the server",
    )
    up: Literal["", "y", "z"] = Field(
        default="",
        description="axis that points up in the stream. Empty: y for Motive (`Up Axis` of its streaming "
        "panel), as QTM states it",
    )
    unit: Literal["m", "mm"] = Field(
        default="m", description="unit of the positions that Motive streams; QTM's are as its protocol says"
    )
    tracker: Name = Field(default="mocap", description="name of the tracker, unique on the site")
    frame: str = Field(
        default="", description="frame of the map that is the cameras' origin on the floor; empty for {W}"
    )
    bodies: dict[str, WornBodyConfig] = Field(
        default={},
        max_length=MAX_BODIES,
        description="meaning of rigid bodies by their names there; others are objects of these names",
    )
    truth: bool = Field(
        default=False,
        description="ground truth: people are published as objects for recordings and compared with their "
        "localization, and no pose is changed",
    )

    @property
    def program(self) -> str:
        """Name of the program that sends the bodies."""
        return "QTM" if self.system == "qtm" else "Motive"

    @model_validator(mode="after")
    def _check_unit_and_parts(self) -> "MocapConfig":
        if self.system == "qtm" and self.unit != "m":
            raise ValueError("unit: QTM streams millimetres by its protocol: leave it out")
        parts = [(body.person, body.part) for body in self.bodies.values() if body.person]
        for person, part in parts:
            if parts.count((person, part)) > 1:
                raise ValueError(f"bodies: two are the {part} of {person}: leave one out")
            if (person, "head") not in parts:
                raise ValueError(f"bodies: {person} has no `part: head`, which gives the position: add one")
        return self
