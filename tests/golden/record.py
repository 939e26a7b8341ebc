"""Messages of a session as hashes and sums: one per key, the same on every machine and supported version."""

import hashlib
import json
import math
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
            bus.subscribe(replace(topic, delivery=Delivery.EVENT), self._reader(topic))

    def _reader(self, topic: Topic[Any]) -> Callable[[Message, str], None]:
        return lambda message, name: self._lines.append((topic.at(name), message))

    def by_key(self) -> dict[str, list[Message]]:
        """Return the messages of each key that has any; keys in the order of the topic table."""
        found: dict[str, list[Message]] = {}
        for key, message in sorted(self._lines, key=lambda line: (_row(line[0]), line[0])):
            found.setdefault(key, []).append(message)
        return found

    def has(self, wanted: str) -> bool:
        """Return True if there is a message on the key `wanted`, for `key=value` one with that value."""
        key, _, value = wanted.partition("=")
        messages = self.by_key().get(key, [])
        return any(not value or value in vars(message).values() for message in messages)

    def hashes(self) -> dict[str, str]:
        """Return `count hash sum` by key, and by key and `SENTENCES` where messages have texts.

        The hash is of all but floats, whose sum is weighted: each has its own weight, ±1 to ±2.
        """
        found: dict[str, str] = {}
        for key, messages in self.by_key().items():
            texts: list[str] = []
            floats: list[float] = []
            lines = [line_of(message, texts, floats) for message in messages]
            found[key] = f"{_hash(lines)} {_weighted(floats):.9g}"
            if texts:
                found[key + SENTENCES] = _hash(texts)
        return found

    def dump(self, path: Path) -> None:
        """Write one line per message, in order of arrival: where two dumps begin to differ is the cause."""
        path.parent.mkdir(parents=True, exist_ok=True)
        lines = [f"{key} {line_of(message)}\n" for key, message in self._lines]
        path.write_text("".join(lines), encoding="utf-8")


def _row(key: str) -> int:
    return TOPICS_HASHED.index(found) if (found := topic_of(key)) else -1


def line_of(message: Message, texts: list[str] | None = None, floats: list[float] | None = None) -> str:
    """Return a message's name, version and fields as one line.

    Texts with spaces are moved to `texts`, and floats to `floats`, if these are given.
    """
    fields = _plain(message.model_dump(), texts, floats)
    return f"{message.schema_name()} {json.dumps(fields, sort_keys=True, ensure_ascii=False)}"


def _plain(value: Any, texts: list[str] | None, floats: list[float] | None) -> Any:
    match value:
        case float() if floats is not None:
            floats.append(value)
            return "~"
        case float():
            return round(value, DECIMALS) + 0.0  # 0.0 instead of -0.0
        case dict():
            return {key: _plain(item, texts, floats) for key, item in cast("dict[str, Any]", value).items()}
        case list() | tuple():
            return [_plain(item, texts, floats) for item in cast("Sequence[Any]", value)]
        case bytes():
            return value.hex()
        case str() if texts is not None and " " in value:
            texts.append(value)
            return SENTENCES
        case _:
            return value


def _hash(lines: list[str]) -> str:
    return f"{len(lines)} {hashlib.sha256(chr(10).join(lines).encode()).hexdigest()[:16]}"


def _weighted(floats: Sequence[float]) -> float:
    def weight(index: int) -> float:
        sign = 1.0 if math.modf(index * math.sqrt(2.0))[0] < 0.5 else -1.0
        return sign * (1.0 + math.modf(index * math.sqrt(5.0))[0])

    return math.fsum(weight(index) * value for index, value in enumerate(floats))


def _are_same(one: str, other: str) -> bool:
    (*ones, its), (*others, that) = one.rsplit(" ", 1), other.rsplit(" ", 1)
    if ones != others or " " not in ones[0]:  # of sentences
        return one == other
    return math.isclose(float(its), float(that), rel_tol=1e-8, abs_tol=TOLERANCE)


def difference(recorded: dict[str, str], now: dict[str, str]) -> str:
    """Return the keys that differ in two `Record.hashes`, the first with its counts, or `""` if none does."""
    keys = list(dict.fromkeys([*recorded, *now]))
    changed = [key for key in keys if not _are_same(recorded.get(key, "- -"), now.get(key, "- -"))]
    if not changed:
        return ""
    was, its = (hashes.get(changed[0], "0").split()[0] for hashes in (recorded, now))
    others = f"; also changed: {', '.join(changed[1:])}" if changed[1:] else ""
    return f"{changed[0]} changed first: {was} messages were recorded, {its} came now{others}"


def read_hashes() -> dict[str, dict[str, str]]:
    recorded: dict[str, dict[str, str]] = json.loads(HASHES.read_text(encoding="utf-8"))
    return recorded


def write_hashes(hashes: dict[str, dict[str, str]]) -> None:
    HASHES.write_text(json.dumps(hashes, indent=1) + "\n", encoding="utf-8")
