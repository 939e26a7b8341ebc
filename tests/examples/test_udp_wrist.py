"""The UDP wrist of docs/how-to/adding.md: datagrams to readings, and the sentence for others."""

import struct

import pytest

from examples.udp_wrist import MY_WRIST
from pointit.plugins import Reading
from tests.support.bench import until
from tests.support.running_source import phone_at, running

SENT = struct.pack("<Iffff", 1500, 0.5, 0.5, -0.5, 0.5)  # ms, w, x, y, z


async def test_datagram_is_a_reading_with_the_devices_time() -> None:
    async with running(MY_WRIST) as wrist, phone_at(wrist.port) as phone:

        def is_read() -> bool:
            phone.say(SENT)
            return bool(wrist.of(Reading))

        await until(is_read)
    reading = wrist.of(Reading)[0]
    assert reading.world_from_sensor == (0.5, -0.5, 0.5, 0.5)
    assert reading.device_time_ns == 1_500_000_000


@pytest.mark.parametrize(
    ("data", "problem"), [(SENT[:-1], "has 19 bytes, 20 were expected"), (bytes(20), "norm")]
)
async def test_unreadable_datagram_is_named_in_health(data: bytes, problem: str) -> None:
    async with running(MY_WRIST) as wrist, phone_at(wrist.port) as phone:

        def is_named() -> bool:
            phone.say(data)
            return problem in wrist.warnings.get("unreadable", "")

        await until(is_named)
        assert not wrist.of(Reading)
