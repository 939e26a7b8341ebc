# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""People as ROS4HRI's libraries list them: the bridge in a graph of its own, read as libhri reads."""

import collections
import contextlib
import functools
from collections.abc import AsyncGenerator
from typing import Any

import pytest
import zenoh
from zenoh import ext
from zenoh.handlers import Callback

from pointit.bridges.ros2.config import BackendConfig, Ros2Config
from pointit.bridges.ros2.service import Ros2
from pointit.schemas import UserPose
from pointit.schemas.topics import POSE, USER_ALIVE
from tests.integration.ros2.nodes import DOMAIN, Graphs, graphs
from tests.support.bench import START_NS, Bench, memory_bench, until
from tests.unit.ros2.facts import golden
from tests.unit.ros2.scenes import jazzy

IDS_LIST = "RIHS01_7e0812d1ac945c98fd3e393568d581ad0ab567f37b24eff633eab778c1bfe62d"
"""Hash of hri_msgs/msg/IdsList by rosbags, as no running ROS 2 with that package could be asked."""
SEEN = 1e-2
"""A person with a lower confidence has no transform."""


class Listener:
    """Faces, bodies and voices by ID, people who are known, and who is tracked."""

    def __init__(self, session: zenoh.Session, domain: int, reference_frame: str = "world") -> None:
        self._session = session
        self._domain = domain
        self._reference_frame = reference_frame
        self._arrived: collections.deque[tuple[str, str, bytes]] = collections.deque()
        """Messages that Zenoh's threads have received: topic, type, CDR."""
        self._ends: dict[tuple[str, str], list[Any]] = {}
        """Subscriptions by list and ID."""
        self.ids: dict[str, set[str]] = {}
        """IDs by list."""
        self.values: dict[str, Any] = {}
        """Last values by topic."""
        self.frames: dict[str, Any] = {}
        """Last transforms of /tf by child frame."""
        for kind in ("faces", "bodies", "voices", "persons"):
            self._hear(f"/humans/{kind}/tracked", "hri_msgs/msg/IdsList")
        self._hear("/humans/persons/known", "hri_msgs/msg/IdsList")
        self._hear("/tf", "tf2_msgs/msg/TFMessage")

    def spin(self) -> None:
        """Handle what has arrived."""
        while self._arrived:
            topic, kind, cdr = self._arrived.popleft()
            value = jazzy().decode(kind, cdr)
            if kind == "hri_msgs/msg/IdsList":
                self._on_ids(topic, set(value.ids))
            elif topic == "/tf":
                self.frames |= {each.child_frame_id: each for each in value.transforms}
            else:
                self.values[topic] = value.data

    def people(self, which: str = "tracked") -> set[str]:
        """Return the IDs of people, `tracked` or `known`."""
        self.spin()
        return self.ids.get(f"/humans/persons/{which}", set())

    def of(self, person: str, what: str) -> Any:
        """Return the last value of a person's topic, or None."""
        self.spin()
        return self.values.get(f"/humans/persons/{person}/{what}")

    def transform(self, person: str) -> Any:
        """Return the person's frame in the reference frame, or None if their location is unknown."""
        frame = self.frames.get(f"person_{person}")
        if (self.of(person, "location_confidence") or 0.0) < SEEN or frame is None:
            return None
        assert frame.header.frame_id == self._reference_frame
        return frame.transform

    def close(self) -> None:
        """Drop all subscriptions."""
        for ends in self._ends.values():
            for end in ends:
                end.undeclare()

    def _on_ids(self, topic: str, ids: set[str]) -> None:
        before, self.ids[topic] = self.ids.get(topic, set()), ids
        for gone in before - ids:
            for end in self._ends.pop((topic, gone), ()):
                end.undeclare()
        if topic.startswith("/humans/persons/"):
            for person in ids - before:
                self._meet(topic, person)

    def _meet(self, topic: str, person: str) -> None:
        hear = functools.partial(self._hear, about=(topic, person))
        for name in ("face_id", "body_id", "voice_id", "alias"):
            hear(f"/humans/persons/{person}/{name}", "std_msgs/msg/String", is_latched=True)
        hear(f"/humans/persons/{person}/anonymous", "std_msgs/msg/Bool", is_latched=True)
        hear(f"/humans/persons/{person}/location_confidence", "std_msgs/msg/Float32")

    def _hear(
        self, topic: str, kind: str, *, is_latched: bool = False, about: tuple[str, str] = ("", "")
    ) -> None:
        package, _, name = kind.split("/")
        key = f"{self._domain}{topic}/{package}::msg::dds_::{name}_/{_hash(kind)}"

        def take(sample: zenoh.Sample) -> None:
            assert sample.attachment is not None
            self._arrived.append((topic, kind, sample.payload.to_bytes()))

        handler = Callback(take, indirect=False)
        end: Any
        if is_latched:
            end = ext.declare_advanced_subscriber(
                self._session,
                key,
                handler,
                history=ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
                recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
                subscriber_detection=True,
            )
        else:
            end = self._session.declare_subscriber(key, handler)
        self._ends.setdefault(about, []).append(end)


def _hash(kind: str) -> str:
    return IDS_LIST if kind == "hri_msgs/msg/IdsList" else f"RIHS01_{golden('hashes')[kind]['hash']}"


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
