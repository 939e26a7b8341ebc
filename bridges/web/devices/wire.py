"""Requests of pages about devices, and the stored devices."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from pointit.bridges.web.wire import DeviceLine

Plugin = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.\-]{1,64}$", description="name of the device's plug-in")]
Address = Annotated[str, Field(max_length=200, pattern=r"^[^\x00-\x1f]*$")]

MAX_DEVICES = 64


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ConnectDevice(_Frozen):
    """Connect a device that was found. A wrist is for a new person, a light for a strip."""

    kind: Literal["wrist", "light"]
    plugin: Plugin
    address: Address = ""
    name: Annotated[
        str,
        Field(
            min_length=1,
            max_length=64,
            pattern=r"^[^\x00-\x1f]*$",
            description="of the person or strip; a strip that is not there is added to the map",
        ),
    ]

    def is_like(self, other: "ConnectDevice") -> bool:
        """Return True if `other` is the same device, under any name."""
        return (self.kind, self.plugin, self.address) == (other.kind, other.plugin, other.address)


class OneDevice(_Frozen):
    """A connected device."""

    id: Annotated[str, Field(max_length=80, description="as in `DeviceLine`")]


class ConnectedDevice(ConnectDevice):
    """A device that is connected at every start."""

    label: Annotated[str, Field(max_length=400)]
    pixels: Annotated[int, Field(ge=0, description="of a light; 0 if it does not say")] = 0
    is_remote: Annotated[bool, Field(description="a wrist that is heard in the network")] = False

    @property
    def id(self) -> str:
        """Return its id: there is one wrist of a person, and one light of a strip."""
        return f"{self.kind} {self.name}"

    @property
    def option(self) -> str:
        """Return the value of `--imu` or `--output` that chooses it."""
        return f"{self.plugin}:{self.address}" if self.address else self.plugin

    def line(self, *, is_on: bool, progress: str, problem: str) -> DeviceLine:
        """Return its line for pages."""
        own = self.model_dump(exclude={"is_remote"})
        return DeviceLine(id=self.id, is_on=is_on, said=progress, problem=problem, **own)


class StoredDevices(_Frozen):
    """The devices that are connected at every start."""

    devices: Annotated[tuple[ConnectedDevice, ...], Field(max_length=MAX_DEVICES)] = ()
