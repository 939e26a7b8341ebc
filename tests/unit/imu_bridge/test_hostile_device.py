"""A device that delivers anything, at any times: imu-bridge goes on, and its samples are in order."""

import asyncio
import math

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pointit.geometry import rotation
from pointit.schemas import ImuSample
from pointit.schemas.topics import IMU
from pointit.services.imu_bridge.reading import (
    Battery,
    Disconnected,
    Item,
    Press,
    RawReading,
    Reading,
    Reconnected,
    Signal,
)
from tests.support.bench import Bench
from tests.unit.imu_bridge.puppet import Puppet, virtually

ANY = st.floats(width=32)
VECTORS = st.tuples(ANY, ANY, ANY) | st.just((0.0, 0.0, 9.81))
UNITS = st.floats(-math.pi, math.pi).map(rotation.from_yaw)
ORIENTATIONS = UNITS | st.tuples(ANY, ANY, ANY, ANY)
TIMES_NS = st.integers(-(2**70), 2**70) | st.integers(0, 10_000_000_000)
DEVICE_NS = st.none() | TIMES_NS


def items(now_ns: int) -> st.SearchStrategy[Item]:
    stamps_ns = st.just(now_ns) | TIMES_NS
    return st.one_of(
        st.builds(Reading, stamps_ns, ORIENTATIONS, DEVICE_NS),
        st.builds(RawReading, stamps_ns, VECTORS, VECTORS, DEVICE_NS),
        st.builds(Press, stamps_ns),
        st.builds(Battery, ANY),
        st.builds(Signal, ANY),
        st.builds(Reconnected, st.booleans()),
        st.builds(Disconnected, st.text(max_size=9)),
    )


@settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(st.data())
def test_device_that_delivers_anything_neither_stops_nor_disorders_the_samples(data: st.DataObject) -> None:
    async def play(bench: Bench, puppet: Puppet) -> None:
        samples: list[ImuSample] = bench.collect(IMU, "anna")
        for _ in range(data.draw(st.integers(1, 40))):
            puppet.give(data.draw(items(bench.clock.now_ns())))
            await asyncio.sleep(data.draw(st.sampled_from((0.0, 0.01, 0.5, 4.0))))
        seen = len(samples)
        puppet.give(Reading(bench.clock.now_ns(), rotation.IDENTITY))
        await asyncio.sleep(0.1)
        assert len(samples) == seen + 1
        assert [sample.seq for sample in samples] == sorted({sample.seq for sample in samples})

    virtually(play)
