"""Output to WLED and other pixel controllers in the network, by DDP."""

from collections.abc import Sequence

from pydantic import Field

from pointit.runtime.errors import ConfigError
from pointit.runtime.service.surroundings import Surroundings
from pointit.services.led_driver.output import ddp_protocol
from pointit.services.led_driver.output.datagram_sender import Datagram, Destination
from pointit.services.led_driver.output.network_output import NetworkOutput, Wire
from pointit.services.led_driver.output.pixel_map import PixelMap
from pointit.services.led_driver.output.wled_search import find_wled
from pointit.services.led_driver.outputs import LedOutput, OutputConfig


class DdpConfig(OutputConfig):
    """A pixel controller in the network that takes DDP, such as WLED."""

    kind: str = Field(default="ddp", description="kind of controller")
    host: str = Field(default="", description="name or address of the controller")
    port: int = Field(default=ddp_protocol.PORT, gt=0, le=65535, description="UDP port of the controller")
    max_rate_hz: float = Field(
        default=66.0, gt=0, le=1000, description="maximum number of frames per second; WLED shows up to 66"
    )


def _encode(pixels: bytes, pixel_map: PixelMap, number: int) -> Sequence[Datagram]:
    return [Datagram(data) for data in ddp_protocol.encode_frame(pixels, pixel_map.colors, number)]


def _make(config: DdpConfig, around: Surroundings) -> NetworkOutput:
    if not config.host:
        raise ConfigError("host: is missing; give the controller's name or address, as in --leds ddp:HOST")
    destination = Destination(host=config.host, port=config.port)
    wire = Wire(encode=_encode, max_rate_hz=config.max_rate_hz)
    address = config.host if config.port == ddp_protocol.PORT else f"{config.host}:{config.port}"
    return NetworkOutput(config, destination, wire, around.health, address)


DDP = LedOutput(
    summary="a pixel controller in the network: WLED, xLights (DDP)",
    config=DdpConfig,
    make=_make,
    argument="host",
    divided_by="port",
    example="HOST",
    discover=find_wled,
)
