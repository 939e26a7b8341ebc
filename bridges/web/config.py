"""Parameters of the page."""

from typing import Literal
from urllib.parse import urlsplit

from pydantic import Field, field_validator

from pointit.runtime.address_config import AddressConfig, described_error
from pointit.runtime.config.config import Config
from pointit.schemas.text import LANGUAGE


class Place(Config):
    """A person's assumed position and heading until their pose is known."""

    position_m: tuple[float, float, float] = Field(description="of their feet in {W}, m")
    yaw_deg: float = Field(default=0.0, description="azimuth of {H}'s x axis in {W}, °")


class WebConfig(AddressConfig):
    """Address of the page, access to it, rates."""

    host: str = Field(default="127.0.0.1", description="listening address, not encrypted")
    port: int = Field(default=8090, ge=0, le=65535, description="port at `host`; 0: any free port")
    published_port: int = Field(
        default=0,
        ge=0,
        le=65535,
        description="port of 127.0.0.1 at which the page is opened, where a container's engine or ssh passes "
        "it on (a container may have host: 0.0.0.0 then); 0: as port",
    )
    public_url: str = Field(
        default="",
        max_length=200,
        description="address at which a reverse proxy serves the page, such as https://lab.example",
    )
    SECRETS = frozenset({"operator_token", "viewer_token", "scan_token"})

    operator_token: str = Field(
        default="", description="token for control; if empty, a random one, written to a file"
    )
    viewer_token: str = Field(default="", description="token for viewing only; if empty, a random one")
    lan: bool = Field(
        default=False, description="open to the local network from the start, by HTTPS; phones need it"
    )
    lan_port: int = Field(default=8443, ge=0, le=65535, description="port for HTTPS; 0: any free port")
    lan_address: str = Field(
        default="", description="this machine's address in the local network; detected if empty"
    )
    rate_hz: float = Field(default=60.0, gt=0, le=240, description="maximum rate of batches to a page, Hz")
    record_s: float = Field(default=60.0, ge=0, le=600, description="length of a recording, s")
    most_viewers: int = Field(
        default=100,
        ge=1,
        le=10_000,
        description="maximum number of open pages (16 in the process of a run, unless set); more are refused",
    )
    announce: Literal["", "page", "phone"] = Field(
        default="",
        description="device that speaks the names that the selector announces: page or phone; people can "
        "change it there. Empty: none",
    )
    language: str = Field(
        default="",
        pattern=LANGUAGE,
        description="language of these names, such as de, unless people choose another. Empty: the browser's",
    )
    devices_at: str = Field(
        default="",
        description="address of the site for the processes of devices that a page connects, set by "
        "`pointit run`; no device can be connected if empty",
    )
    run_output: str = Field(
        default="",
        description="the `--output` of the run, set by `pointit run`; a connected light of that name waits",
    )
    home_folder: str = Field(
        default="",
        description="folder of the home that pages set up, set by `pointit home`; there is none if empty",
    )
    scan_file: str = Field(
        default="", description="suggested path of the map that *Map this room* writes  [default: room.yaml]"
    )
    scan_token: str = Field(
        default="", description="token of the link with which a phone maps the room; no link if empty"
    )
    scan_room: str = Field(
        default="", description="map of the room that a simulated camera maps; no such camera if empty"
    )
    places: dict[str, Place] = Field(
        default_factory=dict[str, Place],
        description="by user: assumed pose of a person until their pose is known",
    )

    @field_validator("public_url")
    @classmethod
    def _is_origin(cls, url: str) -> str:
        """Return the address in small letters and without the slash at its end."""
        if not url:
            return ""
        url = url.lower().removesuffix("/")
        if not _is_encrypted_origin(url):
            raise described_error(
                "write https:// and a host, as in https://lab.example; the page needs a host of its own, and "
                "what leaves this machine is encrypted"
            )
        return url


def _is_encrypted_origin(url: str) -> bool:
    """Return True if `url` is https:// and a host, with a port at most."""
    try:
        parts = urlsplit(url)
        has_host = bool(parts.hostname) and parts.port != 0
    except ValueError:
        return False
    has_user = "@" in parts.netloc
    if not has_host or has_user:
        return False
    return url == f"https://{parts.netloc}"
