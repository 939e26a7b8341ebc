"""Outputs of replayed sessions as they were accepted, and what a replay now changes."""

import hashlib
import json
import lzma
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from pointit.cli.recordings.replay import first_lines
from pointit.recording.entries import Entry
from pointit.recording.reader import Recording
from pointit.replay.comparison import (
    TOLERANCE,
    TOLERANCES,
    Comparison,
    ComparisonReport,
    Sample,
    TopicReport,
    sample_of,
)
from pointit.replay.playing import plan_replay, replay
from pointit.schemas.topics import STRIPS_FRAME, topic_of

ACCEPTED = Path(__file__).with_name("accepted")

DIGITS = {1e-6: 7, 1e-9: 10}
"""Decimals that are stored, by tolerance."""


class Outputs:
    """Messages of the services of a recording when it is replayed."""

    def __init__(self, recording: Recording) -> None:
        self.began_ns = recording.began_ns
        self.samples: list[Sample] = []
        """In order of time, with the pixels of frames as hashes."""
        replay(plan_replay(recording, "edge"), self)

    def recorded(self, entry: Entry) -> None:
        """Take nothing: recordings of the gate hold no outputs."""

    def replayed(self, entry: Entry, *, is_recomputed: bool) -> None:
        if is_recomputed and (sample := sample_of(entry)) is not None:
            self.samples.append(_with_hashes(sample))


def accept(name: str, samples: Sequence[Sample]) -> None:
    lines = [
        json.dumps([each.key, each.time_ns, _rounded(each.content, _digits(each.key))], separators=(",", ":"))
        for each in samples
    ]
    ACCEPTED.mkdir(exist_ok=True)
    data = lzma.compress("\n".join(lines).encode(), preset=9 | lzma.PRESET_EXTREME)
    _path(name).write_bytes(data)


def accepted(name: str) -> Iterator[Sample]:
    path = _path(name)
    if not path.is_file():
        return
    for line in lzma.decompress(path.read_bytes()).decode().splitlines():
        key, time_ns, content = json.loads(line)
        yield Sample(key, time_ns, content["stamp_ns"], content)


def compare(before: Sequence[Sample], now: Sequence[Sample]) -> ComparisonReport:
    """Return the differences of two runs; times must be equal, numbers within the tolerances."""
    comparison = Comparison(time_tolerance_s=0.0)
    sides = [(each.time_ns, 0, each) for each in before] + [(each.time_ns, 1, each) for each in now]
    for _, side, sample in sorted(sides, key=lambda each: each[0]):
        comparison.add("replayed" if side else "recorded", sample)
    return comparison.finish()


def _line(topic: TopicReport) -> str:
    fields = ", ".join(f"{each.field} {each.largest}" for each in topic.fields)
    return f"{topic.key}: differ {topic.differ} of {topic.recorded} and {topic.replayed}: {fields}"


def table(name: str, report: ComparisonReport, began_ns: int) -> str:
    """Return the differences in the session `name` as lines, with the first message that differs."""
    changed = ComparisonReport(topics=tuple(topic for topic in report.topics if not topic.is_same))
    return "\n".join([f"session {name}:", *map(_line, changed.topics), *first_lines(changed, began_ns)])


def _path(name: str) -> Path:
    return ACCEPTED / f"{name}.jsonl.xz"


def _digits(key: str) -> int:
    row = topic_of(key)
    return DIGITS[TOLERANCES.get(row.key, TOLERANCE) if row else TOLERANCE]


def _with_hashes(sample: Sample) -> Sample:
    """Return `sample` as JSON has it: tuples as lists, the pixels of a frame as one hash."""
    content = dict(sample.content)
    if sample.key == STRIPS_FRAME.key:
        pixels = hashlib.sha256()
        for strip in content.pop("strips"):
            pixels.update(strip["id"].encode() + b"\0" + strip["rgb"])
        content["pixels"] = pixels.hexdigest()[:8]
    return sample._replace(content=cast("dict[str, Any]", _listed(content)))


def _listed(value: object) -> object:
    if isinstance(value, Mapping):
        return {name: _listed(item) for name, item in cast("Mapping[str, object]", value).items()}
    if isinstance(value, (list, tuple)):
        return [_listed(item) for item in cast("Sequence[object]", value)]
    return value


def _rounded(value: object, digits: int) -> object:
    if isinstance(value, float):
        return round(value, digits) + 0.0
    if isinstance(value, dict):
        return {name: _rounded(item, digits) for name, item in cast("dict[str, object]", value).items()}
    if isinstance(value, list):
        return [_rounded(item, digits) for item in cast("list[object]", value)]
    return value
