"""A controller of Adalight on a serial port, which a thread opens and writes."""

from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import Strip, StripFrame, StripsFrame
from pointit.services.led_driver.output.adalight import AdalightConfig, AdalightOutput
from pointit.testing import PtyDevice
from tests.support.bench import background, until


async def test_port_opens_with_a_dark_frame_that_contains_no_command() -> None:
    device = PtyDevice()
    await device.plug()
    output = AdalightOutput(
        AdalightConfig(port=str(device.path), baud=4_000_000, gamma=1.0), Surroundings.detached()
    )
    output.set_strips([Strip(id="a", line_m=((0, 0, 0), (1, 0, 0)), pixels=2)])
    output.show(StripsFrame(stamp_ns=1, strips=(StripFrame(id="a", rgb=b"\xb1X\1\2\3\4"),)))
    header = bytes.fromhex("416461000154")
    dark = header + bytes(6)
    frame = header + b"\xb1X\1\2\3\4"
    # On a busy machine this device is read so late that the port is opened again, with another dark frame.
    async with background(output.run()):
        await until(lambda: frame in device.received)

    assert device.received.startswith(dark)
    await device.unplug()
    device.close()
