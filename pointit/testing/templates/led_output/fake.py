"""The controller in software, for tests and `pointit plugin check`."""

from pointit.testing import LedHarness, UdpDevice
from pointit.testing.templates.led_output import OUTPUT


def decode(received: bytes) -> list[bytes]:
    """Return the complete frames in `received`: 3 bytes a pixel, red, green, blue, all strips in order."""
    *lines, _unfinished = received.split(b"\n")
    return [bytes.fromhex(line.decode()) for line in lines]


DEVICE = LedHarness(
    plugin=OUTPUT,
    device=UdpDevice,
    parameters=lambda device: {"host": device.host, "port": device.port},
    decode=decode,
    wrong_parameters=({"host": ""}, {"host": "leds.local", "port": 0}),
)
