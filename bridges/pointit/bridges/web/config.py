"""Parameters of the page."""

from pydantic import Field

from pointit.runtime.config.config import Config


class Place(Config):
    """Where a person is taken to stand until their pose is known."""

    position_m: tuple[float, float, float] = Field(description="of their feet in {W}, m")
    yaw_deg: float = Field(default=0.0, description="azimuth of {H}'s x axis in {W}, °")


class WebConfig(Config):
    """Where the page is, who may see it, how often it is told."""

    host: str = Field(default="127.0.0.1", description="address to listen at, without encryption")
    port: int = Field(default=8090, ge=0, le=65535, description="port there; 0: any that is free")
    published_port: int = Field(
        default=0,
        ge=0,
        le=65535,
        description="port of 127.0.0.1 at which the page is opened, where a container's engine or ssh passes "
        "it on (a container may have host: 0.0.0.0 then); 0: as port",
    )
    operator_token: str = Field(
        default="", description="whoever has it may control; empty: made at random, and kept in a file"
    )
    viewer_token: str = Field(default="", description="whoever has it may look on; empty: made at random")
    lan: bool = Field(
        default=False, description="open to the local network from the start, by HTTPS; phones need it"
    )
    lan_port: int = Field(default=8443, ge=0, le=65535, description="port there; 0: any that is free")
    lan_address: str = Field(
        default="", description="this machine's address in the local network; empty: found out"
    )
    rate_hz: float = Field(default=60.0, gt=0, le=240, description="batches a second to a page at most")
    wrist_rate_hz: float = Field(
        default=60.0, ge=5, le=200, description="samples a second of an arm that a mouse moves"
    )
    record_s: float = Field(default=60.0, ge=0, le=600, description="what a recording goes back to, s")
    most_viewers: int = Field(default=100, ge=1, le=10_000, description="pages at a time; more are refused")
    places: dict[str, Place] = Field(
        default_factory=dict[str, Place], description="by user: where a person stands until a pose is known"
    )
