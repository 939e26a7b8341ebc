# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""A reader of people that does what libhri's `HRIListener` (pyhri) does, on a bare Zenoh session.

It reads the lists as volatile, subscribes to the topics of an ID when a list names it, and drops them when
the list no longer does. Keys are those of rmw_zenoh, written here with hashes of a running ROS 2.
"""

import collections
import functools
from typing import Any

import zenoh
from zenoh import ext
from zenoh.handlers import Callback

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
