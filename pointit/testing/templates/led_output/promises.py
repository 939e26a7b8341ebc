"""Promises of an LED output, with its controller in software, for tests and `pointit plugin check`."""

from pointit.testing import LedOutputContract, UdpDevice
from pointit.testing.templates.led_output import OUTPUT


class OutputPromises(LedOutputContract):
    """Contract of this plug-in: one test for each promise."""

    plugin = OUTPUT
    wrong_parameters = ({"host": ""}, {"host": "leds.local", "port": 0})
    device = UdpDevice

    def decode(self, received: bytes) -> list[bytes]:
        """Return the complete frames in `received`: 3 bytes a pixel, red, green, blue, strips in order."""
        *lines, _unfinished = received.split(b"\n")
        return [bytes.fromhex(line.decode()) for line in lines]
