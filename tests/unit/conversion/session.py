"""A small invented session: entries, and a recording of them."""

from collections.abc import Iterable
from pathlib import Path

from pointit.recording.entries import AnyRow, Body, Entry, entry
from pointit.schemas import NS_PER_S
from tests.support.recorded import write_recording

BEGAN_NS = 1_000 * NS_PER_S


def at(time_s: float) -> int:
    return BEGAN_NS + round(time_s * NS_PER_S)


def said(time_s: float, row: AnyRow, name: str, body: Body) -> Entry:
    return entry(at(time_s), row, name, body)


def write(path: Path, entries: Iterable[Entry]) -> Path:
    return write_recording(path, entries, BEGAN_NS)
