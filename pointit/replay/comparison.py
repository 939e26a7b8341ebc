"""Compares two runs message by message, as plain values, while both go on; pure, with bounded memory."""

import collections
import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, cast

from pydantic import Field

from pointit.recording.entries import Entry, Exchange
from pointit.schemas import NS_PER_S, Message, SchemaModel
from pointit.schemas.topics import POSE, RAY, topic_of

Side = Literal["recorded", "replayed"]

IGNORED = frozenset(("seq",))
"""Fields that say nothing about what happened: a replay counts from its own beginning."""

TOLERANCES: Mapping[str, float] = {POSE.key: 1e-6, RAY.key: 1e-9}
"""Difference of numbers that is ignored, by topic, m, rad or 1."""

TOLERANCE = 1e-6
"""The same for all other topics. Bytes, such as pixels, must be equal."""

TIME_TOLERANCE_S = 0.1
"""Difference of times that is ignored, s: a recorder gets a message a little after the services did."""

PAIRING_TIMEOUT_NS = 2 * NS_PER_S
"""After this time a message whose stamp the other run does not have is paired with a near one, or missing."""

NEAR_NS = NS_PER_S // 2
"""Largest difference of the times of two messages with different stamps that are a pair, ns."""


class Sample(NamedTuple):
    """A message, as it is compared."""

    key: str
    time_ns: int
    """When it was put, time of the recording."""
    stamp_ns: int
    content: dict[str, Any]
    """Its fields."""


def sample_of(entry: Entry) -> Sample | None:
    """Return the message or the answered request of `entry`, or None if it is neither."""
    body = entry.body
    if not isinstance(body, (Message, Exchange)):
        return None
    fields = body.model_dump()
    content = {name: value for name, value in fields.items() if name not in IGNORED}
    return Sample(entry.key, entry.time_ns, body.stamp_ns, content)


class Leaf(NamedTuple):
    """A field in which two messages differ."""

    field: str
    """Path in the message, without the numbers of list items: `objects.position_m`."""
    difference: float | None
    """Its size, s for times, otherwise in the field's own unit. None if it is no number."""
    is_exact: bool = False
    """True if any difference counts, because values are bytes, such as pixels."""


def differences(one: object, other: object, field: str = "") -> list[Leaf]:
    """Return the fields in which two plain values differ at all."""
    if one == other:
        return []
    a_number = _number(one)
    other_number = _number(other)
    if a_number is not None and other_number is not None:
        size = abs(a_number - other_number)
        if field.endswith("_ns"):
            return [Leaf(field, size / 1e9)]
        return [Leaf(field, float(size))]

    # Mappings, by field
    if isinstance(one, dict) and isinstance(other, dict):
        a = cast("dict[str, Any]", one)
        b = cast("dict[str, Any]", other)
        path = f"{field}." if field else ""
        leaves: list[Leaf] = []
        for name in a | b:
            leaves += differences(a.get(name), b.get(name), f"{path}{name}")
        return leaves

    # Sequences: bytes by the largest difference, lists by item
    if isinstance(one, bytes) and isinstance(other, bytes):
        worst = max((abs(x - y) for x, y in zip(one, other, strict=False)), default=0)
        difference = float(worst) if len(one) == len(other) else None
        return [Leaf(field, difference, is_exact=True)]
    if isinstance(one, (list, tuple)) and isinstance(other, (list, tuple)):
        c = cast("list[Any]", one)
        d = cast("list[Any]", other)
        if len(c) != len(d):
            return [Leaf(field, None)]
        leaves = []
        for x, y in zip(c, d, strict=True):
            leaves += differences(x, y, field)
        return leaves
    return [Leaf(field, None)]


def _number(value: object) -> float | None:
    if isinstance(value, bool):
        return None
    return value if isinstance(value, int | float) else None


class FieldReport(SchemaModel):
    """Differences in one field of a topic's messages."""

    field: str
    differ: int = Field(description="messages in which it differs by more than the tolerance")
    largest: float | None = Field(description="largest difference, s for times; None if it is no number")


class Divergence(SchemaModel):
    """The first message of a topic that differs."""

    time_ns: int = Field(description="time in the recording, Unix ns")
    key: str
    fields: tuple[str, ...] = Field(description="those that differ; empty if one of the two is missing")
    recorded: dict[str, Any] | None = Field(description="None if only the replay has it")
    replayed: dict[str, Any] | None = Field(description="None if only the recording has it")


class TopicReport(SchemaModel):
    """Differences in one key."""

    key: str
    recorded: int = Field(description="messages in the recording")
    replayed: int = Field(description="messages of the replay")
    differ: int = Field(description="pairs of messages that differ by more than the tolerances")
    only_recorded: int
    only_replayed: int
    shift_s: float = Field(description="largest difference of the times of two paired messages")
    fields: tuple[FieldReport, ...] = Field(description="the most frequent first")
    first: Divergence | None

    @property
    def is_same(self) -> bool:
        """Return True if no message differs or is missing."""
        if self.differ:
            return False
        return not (self.only_recorded or self.only_replayed)


class ComparisonReport(SchemaModel):
    """All recomputed topics of a recording, in the order of their keys."""

    topics: tuple[TopicReport, ...]

    @property
    def is_same(self) -> bool:
        """Return True if no topic differs."""
        return all(topic.is_same for topic in self.topics)

    @property
    def first(self) -> Divergence | None:
        """Return the earliest divergence, or None."""
        divergences = [topic.first for topic in self.topics if topic.first is not None]
        return min(divergences, key=lambda divergence: divergence.time_ns, default=None)


@dataclass
class _Field:
    differ: int = 0
    largest: float | None = None


class _Waiting:
    """Messages of one side without a partner so far, in order of time."""

    def __init__(self) -> None:
        self._samples = collections.OrderedDict[int, Sample]()
        """By a number that counts up."""
        self._by_stamp: dict[int, collections.deque[int]] = {}
        self._numbers = itertools.count()

    def __len__(self) -> int:
        return len(self._samples)

    def add(self, sample: Sample) -> None:
        """Add `sample`, which is not older than the others."""
        number = next(self._numbers)
        self._samples[number] = sample
        self._by_stamp.setdefault(sample.stamp_ns, collections.deque()).append(number)

    def take(self, stamp_ns: int) -> Sample | None:
        """Remove the first message of that stamp and return it, or None if there is none."""
        numbers = self._by_stamp.get(stamp_ns)
        return None if numbers is None else self._remove(numbers[0])

    def take_before(self, time_ns: int) -> Sample | None:
        """Remove the first message and return it, or None if none is older than `time_ns`."""
        number = next(iter(self._samples), None)
        if number is None or self._samples[number].time_ns >= time_ns:
            return None
        return self._remove(number)

    def take_near(self, time_ns: int) -> Sample | None:
        """Remove the message whose time is nearest and return it, or None if none is within `NEAR_NS`."""
        nearest = None
        min_distance_ns = NEAR_NS + 1
        for number, sample in self._samples.items():
            distance = abs(sample.time_ns - time_ns)
            if distance < min_distance_ns:
                nearest = number
                min_distance_ns = distance
            if sample.time_ns >= time_ns:
                break
        return None if nearest is None else self._remove(nearest)

    def _remove(self, number: int) -> Sample:
        sample = self._samples.pop(number)
        numbers = self._by_stamp[sample.stamp_ns]
        numbers.remove(number)
        if not numbers:
            del self._by_stamp[sample.stamp_ns]
        return sample


@dataclass
class _Topic:
    tolerance: float
    counts: collections.Counter[Side] = field(default_factory=collections.Counter[Side])
    waiting: dict[Side, "_Waiting"] = field(
        default_factory=lambda: {"recorded": _Waiting(), "replayed": _Waiting()}
    )
    differ: int = 0
    missing: collections.Counter[Side] = field(default_factory=collections.Counter[Side])
    """Messages that only this side has."""
    shift_ns: int = 0
    fields: dict[str, _Field] = field(default_factory=dict[str, _Field])
    first: Divergence | None = None

    def remember(
        self, recorded: Sample | None, replayed: Sample | None, fields: tuple[str, ...] = ()
    ) -> None:
        """Keep a pair that differs, or a message without a partner, if it is the first."""
        samples = [sample for sample in (recorded, replayed) if sample is not None]
        time_ns = min(sample.time_ns for sample in samples)
        if self.first is not None and time_ns >= self.first.time_ns:
            return
        recorded_content = None if recorded is None else recorded.content
        replayed_content = None if replayed is None else replayed.content
        self.first = Divergence(
            time_ns=time_ns,
            key=samples[0].key,
            fields=fields,
            recorded=recorded_content,
            replayed=replayed_content,
        )


class Comparison:
    """Pairs the messages of a recording and of its replay by key and stamp."""

    def __init__(self, *, time_tolerance_s: float = TIME_TOLERANCE_S) -> None:
        self._time_tolerance_s = time_tolerance_s
        self._topics: dict[str, _Topic] = {}
        self._looked_ns = 0

    def add(self, side: Side, sample: Sample) -> None:
        """Add a message of one side.

        Each side's messages arrive in order of time, in parallel with the other's.
        """
        topic = self._topics.get(sample.key)
        if topic is None:
            row = topic_of(sample.key)
            tolerance = TOLERANCES.get(row.key, TOLERANCE) if row else TOLERANCE
            topic = _Topic(tolerance)
            self._topics[sample.key] = topic
        topic.counts[side] += 1
        others = topic.waiting["replayed" if side == "recorded" else "recorded"]
        partner = others.take(sample.stamp_ns)
        if partner is None:
            topic.waiting[side].add(sample)
        elif side == "recorded":
            self._compare(topic, sample, partner)
        else:
            self._compare(topic, partner, sample)
        if sample.time_ns - self._looked_ns > PAIRING_TIMEOUT_NS // 4:
            self._looked_ns = sample.time_ns
            self._give_up(sample.time_ns - PAIRING_TIMEOUT_NS)

    def finish(self) -> ComparisonReport:
        """Return the result. To be called after the last message."""
        self._give_up(2**63)
        topics = [_report(key, topic) for key, topic in sorted(self._topics.items())]
        return ComparisonReport(topics=tuple(topics))

    def _give_up(self, before_ns: int) -> None:
        """Pair what waits since `before_ns` by time, or count it as missing."""
        for topic in self._topics.values():
            recorded = topic.waiting["recorded"]
            replayed = topic.waiting["replayed"]
            while (sample := recorded.take_before(before_ns)) is not None:
                # Messages of the replay that are too old for this one are too old for all later ones
                while (stale := replayed.take_before(sample.time_ns - NEAR_NS)) is not None:
                    self._miss(topic, "replayed", stale)
                partner = replayed.take_near(sample.time_ns)
                if partner is None:
                    self._miss(topic, "recorded", sample)
                else:
                    self._compare(topic, sample, partner)
            while (stale := replayed.take_before(before_ns)) is not None:
                self._miss(topic, "replayed", stale)

    def _compare(self, topic: _Topic, recorded: Sample, replayed: Sample) -> None:
        if recorded.content == replayed.content:
            return
        shift_ns = abs(recorded.stamp_ns - replayed.stamp_ns)
        topic.shift_ns = max(topic.shift_ns, shift_ns)

        # The largest difference of each field, of all items of a list
        leaves: dict[str, Leaf] = {}
        for leaf in differences(recorded.content, replayed.content):
            if not self._matters(leaf, topic.tolerance):
                continue
            largest = leaves.get(leaf.field)
            if largest is None or _size(leaf) > _size(largest):
                leaves[leaf.field] = leaf
        if not leaves:
            return
        topic.differ += 1
        for name, leaf in leaves.items():
            entry = topic.fields.setdefault(name, _Field())
            entry.differ += 1
            if leaf.difference is not None:
                entry.largest = max(entry.largest or 0.0, leaf.difference)
        topic.remember(recorded, replayed, tuple(leaves))

    def _matters(self, leaf: Leaf, tolerance: float) -> bool:
        if leaf.difference is None or leaf.is_exact:
            return True
        if leaf.field.endswith("_ns"):
            return leaf.difference > self._time_tolerance_s
        return leaf.difference > tolerance

    @staticmethod
    def _miss(topic: _Topic, side: Side, sample: Sample) -> None:
        topic.missing[side] += 1
        if side == "recorded":
            topic.remember(sample, None)
        else:
            topic.remember(None, sample)


def _size(leaf: Leaf) -> float:
    return leaf.difference or 0.0


def _report(key: str, topic: _Topic) -> TopicReport:
    fields: list[FieldReport] = []
    for name, counted in sorted(topic.fields.items(), key=lambda item: (-item[1].differ, item[0])):
        fields.append(FieldReport(field=name, differ=counted.differ, largest=counted.largest))
    return TopicReport(
        key=key,
        recorded=topic.counts["recorded"],
        replayed=topic.counts["replayed"],
        differ=topic.differ,
        only_recorded=topic.missing["recorded"],
        only_replayed=topic.missing["replayed"],
        shift_s=topic.shift_ns / NS_PER_S,
        fields=tuple(fields),
        first=topic.first,
    )
