"""Messages of a session as hashes and sums: one per key, the same on every machine and supported version."""

import hashlib
import json
import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from pointit.runtime.bus.contract import Bus
from pointit.schemas import Message
from pointit.schemas.topics import ACCOUNTS, TOPICS, Delivery, Topic, topic_of

TOPICS_HASHED: tuple[Topic[Any], ...] = tuple(topic for topic in TOPICS if topic not in ACCOUNTS)
"""All but what the runtime reports: load and delays of this machine, parameters, requests."""

TOLERANCE = 1e-5
"""Largest difference of two weighted sums of floats that are the same: last digits differ between versions of
Python and NumPy, and CPUs, so that floats, however rounded, cannot be hashed."""

DECIMALS = 6
"""Floats of dumps are rounded."""

HASHES = Path(__file__).with_name("hashes.json")

SENTENCES = " (sentences)"
"""Suffix of the entry for the texts of a key: a change of wording alone shows there alone."""


class Record:
    """All messages of a session."""

    def __init__(self, bus: Bus) -> None:
        """Subscribe to every hashed topic of `bus`, as events: no message replaces an earlier one."""
        self._lines: list[tuple[str, Message]] = []
        """Key and message, in the order of arrival."""
        for topic in TOPICS_HASHED:
            event_topic = replace(topic, delivery=Delivery.EVENT)
            bus.subscribe(event_topic, self._reader(topic))

    def _reader(self, topic: Topic[Any]) -> Callable[[Message, str], None]:
        def on_message(message: Message, name: str) -> None:
            self._lines.append((topic.at(name), message))

        return on_message

    def by_key(self) -> dict[str, list[Message]]:
        """Return the messages of each key that has any; keys in the order of the topic table."""
        by_key = defaultdict[str, list[Message]](list)
        for key, message in self._lines:
            by_key[key].append(message)
        return {key: by_key[key] for key in sorted(by_key, key=_rank)}

    def has(self, wanted: str) -> bool:
        """Return True if there is a message on the key `wanted`, for `key=value` one with that value."""
        key, _, value = wanted.partition("=")
        messages = self.by_key().get(key, [])
        if not value:
            return bool(messages)
        return any(value in vars(message).values() for message in messages)

    def hashes(self) -> dict[str, str]:
        """Return `count hash sum` by key, and by key and `SENTENCES` where messages have texts.

        The hash is of all but floats, whose sum is weighted: each has its own weight, ±1 to ±2.
        """
        hashes: dict[str, str] = {}
        for key, messages in self.by_key().items():
            texts: list[str] = []
            floats: list[float] = []
            lines = [line_of(message, texts, floats) for message in messages]
            hashes[key] = f"{_hash(lines)} {_weighted(floats):.9g}"
            if texts:
                hashes[key + SENTENCES] = _hash(texts)
        return hashes

    def dump(self, path: Path) -> None:
        """Write one line per message, in order of arrival: where two dumps begin to differ is the cause."""
        path.parent.mkdir(parents=True, exist_ok=True)
        lines = [f"{key} {line_of(message)}\n" for key, message in self._lines]
        path.write_text("".join(lines), encoding="utf-8")


def _rank(key: str) -> tuple[int, str]:
    """Return the sort key of a message's key: its row in the topic table, then its name."""
    topic = topic_of(key)
    if topic is None:
        return -1, key
    return TOPICS_HASHED.index(topic), key


def line_of(message: Message, texts: list[str] | None = None, floats: list[float] | None = None) -> str:
    """Return a message's name, version and fields as one line.

    Texts with spaces are moved to `texts`, and floats to `floats`, if these are given.
    """
    fields = _plain(message.model_dump(), texts, floats)
    text = json.dumps(fields, sort_keys=True, ensure_ascii=False)
    return f"{message.schema_name()} {text}"


def _plain(value: Any, texts: list[str] | None, floats: list[float] | None) -> Any:
    match value:
        case float() if floats is not None:
            floats.append(value)
            return "~"
        case float():
            return round(value, DECIMALS) + 0.0  # 0.0 instead of -0.0
        case dict():
            entries = cast("dict[str, Any]", value)
            return {key: _plain(item, texts, floats) for key, item in entries.items()}
        case list() | tuple():
            items = cast("Sequence[Any]", value)
            return [_plain(item, texts, floats) for item in items]
        case bytes():
            return value.hex()
        case str() if texts is not None and " " in value:
            texts.append(value)
            return SENTENCES
        case _:
            return value


def _hash(lines: list[str]) -> str:
    digest = hashlib.sha256("\n".join(lines).encode())
    return f"{len(lines)} {digest.hexdigest()[:16]}"


def _weighted(floats: Sequence[float]) -> float:
    total: list[float] = []
    for index, value in enumerate(floats):
        # irrational steps: no weights repeat, and sums of swapped values differ
        sign_part, _ = math.modf(index * math.sqrt(2.0))
        size_part, _ = math.modf(index * math.sqrt(5.0))
        sign = 1.0 if sign_part < 0.5 else -1.0
        weight = sign * (1.0 + size_part)
        total.append(weight * value)
    return math.fsum(total)


def _are_same(one: str, other: str) -> bool:
    *head, total = one.rsplit(" ", 1)
    *other_head, other_total = other.rsplit(" ", 1)
    if head != other_head or " " not in head[0]:  # of sentences
        return one == other
    return math.isclose(float(total), float(other_total), rel_tol=1e-8, abs_tol=TOLERANCE)


def difference(recorded: dict[str, str], now: dict[str, str]) -> str:
    """Return the keys that differ in two `Record.hashes`, the first with its counts, or `""` if none does."""
    keys = dict.fromkeys([*recorded, *now])
    changed: list[str] = []
    for key in keys:
        if not _are_same(recorded.get(key, "- -"), now.get(key, "- -")):
            changed.append(key)
    if not changed:
        return ""
    first, *others = changed
    recorded_count, *_ = recorded.get(first, "0").split()
    new_count, *_ = now.get(first, "0").split()
    text = f"{first} changed first: {recorded_count} messages were recorded, {new_count} came now"
    return f"{text}; also changed: {', '.join(others)}" if others else text


def read_hashes() -> dict[str, dict[str, str]]:
    text = HASHES.read_text(encoding="utf-8")
    recorded: dict[str, dict[str, str]] = json.loads(text)
    return recorded


def write_hashes(hashes: dict[str, dict[str, str]]) -> None:
    text = json.dumps(hashes, indent=1) + "\n"
    HASHES.write_text(text, encoding="utf-8")
