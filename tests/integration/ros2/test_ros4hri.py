"""People as ROS4HRI's libraries list them: the bridge in a graph of its own, read as libhri reads."""

import contextlib
from collections.abc import AsyncGenerator

import pytest

from pointit.bridges.ros2.config import BackendConfig, Ros2Config
from pointit.bridges.ros2.service import Ros2
from pointit.schemas import UserPose
from pointit.schemas.topics import POSE, USER_ALIVE
from tests.integration.ros2.hri_listener import Listener
from tests.integration.ros2.nodes import DOMAIN, Graphs, graphs
from tests.support.bench import START_NS, Bench, memory_bench, until

COME_S = 10.0
BODY_FRAME, HEAD_FRAME = "body_anna_lena_body", "head_anna_lena_body"


@contextlib.asynccontextmanager
async def listener(at: Graphs) -> AsyncGenerator[Listener]:
    made = Listener(await at.stranger(), DOMAIN)
    yield made
    made.close()


def stand(bench: Bench, user: str, x_m: float, sigma_m: float = 0.05) -> None:
    spread = (sigma_m**2, 0.0, 0.0, 0.0, sigma_m**2, 0.0, 0.0, 0.0, 0.01)
    bench.put(
        POSE, UserPose(stamp_ns=START_NS, position_m=(x_m, 2.0, 0.0), yaw_rad=0.0, covariance=spread), user
    )


async def test_people_are_listed_with_their_place_and_leave_as_they_do() -> None:
    async with graphs() as at, memory_bench() as bench:
        await at.node("/router", "router")
        backend = BackendConfig(mode="peer", endpoint=at.endpoint, domain_id=DOMAIN)
        bridge = bench.start(Ros2, Ros2Config(backend=backend, ros4hri=True))
        anna = bench.bus.announce(USER_ALIVE, "anna-lena")
        stand(bench, "anna-lena", 1.0)
        async with listener(at) as early:
            await until(lambda: early.people() == {"anna_lena"}, COME_S, "the first person")
            ben = bench.bus.announce(USER_ALIVE, "ben")
            stand(bench, "nobody", 3.0)
            stand(bench, "ben", 2.0, sigma_m=1.0)
            await until(lambda: early.people() == {"anna_lena", "ben"}, COME_S, "the second person")
            await until(lambda: early.transform("ben") is not None, COME_S, "his place")
            at_m = early.transform("ben").translation
            assert (at_m.x, at_m.y, at_m.z) == pytest.approx((2.0, 2.0, 1.64))
            assert early.of("ben", "location_confidence") == pytest.approx(0.1175, abs=1e-4)
            async with listener(at) as late:
                await until(lambda: is_known(late), COME_S, "those who were there before")

            anna.close()
            await until(lambda: early.people() == {"ben"}, COME_S, "her to leave")
            await until(lambda: early.of("anna_lena", "body_id") == "", COME_S, "the end of her body")
            await until(lambda: early.transform("anna_lena") is None, COME_S, "the end of her place")
            assert early.people("known") == {"anna_lena", "ben"}
            anna = bench.bus.announce(USER_ALIVE, "anna-lena")
            await until(lambda: early.people() == {"anna_lena", "ben"}, COME_S, "her to come back")
            await until(lambda: early.transform("anna_lena") is not None, COME_S, "her place, as it was")

            await bench.end(bridge)
            await until(
                lambda: not early.people() | early.people("known"), COME_S, "lists to end with the bridge"
            )
            anna.close()
            ben.close()


def is_known(late: Listener) -> bool:
    """Return True if all that is told about people who were there before the listener has come."""
    if late.transform("anna_lena") is None or not {BODY_FRAME, HEAD_FRAME} <= late.frames.keys():
        return False
    body, head = late.frames[BODY_FRAME], late.frames[HEAD_FRAME]
    assert (body.header.frame_id, head.header.frame_id) == ("world", BODY_FRAME)
    assert body.transform.translation.z + head.transform.translation.z == pytest.approx(1.64)
    told = [late.of("anna_lena", what) for what in ("location_confidence", "anonymous", "body_id")]
    return (
        told == [1.0, False, "anna_lena_body"]
        and late.people("known") == {"anna_lena", "ben"}
        and late.ids.get("/humans/bodies/tracked") == {"anna_lena_body", "ben_body"}
    )
