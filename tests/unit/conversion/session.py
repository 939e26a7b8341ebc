"""A small invented session: entries, and a recording of them."""

from collections.abc import Iterable
from pathlib import Path

from pointit.recording.entries import AnyRow, Body, Entry, entry, make_head
from pointit.recording.writer import RecordingWriter
from pointit.schemas import NS_PER_S

BEGAN_NS = 1_000 * NS_PER_S


def at(time_s: float) -> int:
    return BEGAN_NS + round(time_s * NS_PER_S)


def said(time_s: float, row: AnyRow, name: str, body: Body) -> Entry:
    return entry(at(time_s), row, name, body)


def write(path: Path, entries: Iterable[Entry]) -> Path:
    with path.open("wb") as file:
        writer = RecordingWriter(file, make_head("lab", BEGAN_NS))
        for each in entries:
            writer.add(each)
        writer.close()
    return path
