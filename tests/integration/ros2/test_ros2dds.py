# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""The format of zenoh-bridge-ros2dds between two of ours: the same contract with other keys."""

import pytest
import zenoh
from zenoh.handlers import Callback

from pointit.bridges.ros2.backend import LATCHED, SENSOR
from tests.integration.ros2.nodes import ADD, BOOL, POSE, RELIABLE, arrives, cdr_of, graphs, number_of
from tests.support.bench import until


async def test_topics_services_and_graph_both_ways(caplog: pytest.LogCaptureFixture) -> None:
    async with graphs() as at:
        a = await at.node("/a", "router", kind="ros2dds")
        assert "not been tried" in caplog.text
        kept = a.backend.advertise("/user1/state", BOOL, LATCHED)
        kept.put(cdr_of(1))
        kept.put(cdr_of(2))
        b = await at.node("/b", kind="ros2dds")
        state = b.hears("/user1/state", BOOL, LATCHED)
        await until(lambda: state == [2])

        async def add(request: bytes) -> bytes:
            return cdr_of(number_of(request) + 1)

        for here, there in ((a, b), (b, a)):
            topic = f"/from{here.backend.node}"
            seen, own = there.hears(topic, POSE, SENSOR), here.hears(topic, POSE, SENSOR)
            writer = here.backend.advertise(topic, POSE, SENSOR)
            await arrives(lambda writer=writer: writer.put(cdr_of(5)), seen)  # type: ignore[misc]
            assert not own
            here.backend.serve(f"{topic}/add", ADD, add)
            assert number_of(await there.backend.call(f"{topic}/add", ADD, cdr_of(1), timeout_s=10)) == 2
        await until(lambda: len(a.graph.endpoints) == len(b.graph.endpoints) == 12)
        (endpoint,) = [each for each in b.graph.endpoints if each.name == "/user1/state" and not each.is_ours]
        assert (endpoint.kind, endpoint.type, endpoint.qos) == ("publisher", BOOL, LATCHED)
        assert not a.graph.unreadable
        with pytest.raises(TimeoutError, match="nobody serves it"):
            await b.backend.call("/none", ADD, cdr_of(1), timeout_s=0.2)


async def test_what_is_on_the_wire_has_no_domain_no_type_and_no_attachment() -> None:
    async with graphs() as at:
        a = await at.node("/a", "router", kind="ros2dds")
        stranger = await at.stranger()
        samples: list[zenoh.Sample] = []
        subscriber = stranger.declare_subscriber("user1/ray", Callback(samples.append, indirect=False))
        writer = a.backend.advertise("/user1/ray", POSE, RELIABLE)
        await arrives(lambda: writer.put(cdr_of(5)), samples)
        assert samples[0].payload.to_bytes() == cdr_of(5)
        assert samples[0].attachment is None
        seen = a.hears("/x", POSE)
        stranger.put("x", cdr_of(1), attachment=b"whatever")
        stranger.put("x", cdr_of(1))
        await until(lambda: seen == [1, 1])
        subscriber.undeclare()
