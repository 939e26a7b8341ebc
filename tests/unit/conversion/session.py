"""Invented sessions: entries, a recording of them, and one of people, a tracker and a cup."""

import math
from collections.abc import Iterable
from pathlib import Path

from pointit.recording.entries import AnyRow, Body, Entry, entry
from pointit.schemas import (
    NS_PER_S,
    Cursor,
    Hover,
    ImuSample,
    SelectionEvent,
    TrackedObject,
    TrackedObjects,
    UserPose,
    topics,
)
from tests.support.recorded import write_recording

BEGAN_NS = 1_000 * NS_PER_S


def at(time_s: float) -> int:
    return BEGAN_NS + round(time_s * NS_PER_S)


def said(time_s: float, row: AnyRow, name: str, body: Body) -> Entry:
    return entry(at(time_s), row, name, body)


def write(path: Path, entries: Iterable[Entry]) -> Path:
    return write_recording(path, entries, BEGAN_NS)


def session(*people: str) -> list[Entry]:
    """Return entries of `people`. The cup is lost for a while, and the gyroscope sends late."""
    entries: list[Entry] = []
    for tick in range(40):
        time_s = 0.5 + 0.02 * tick
        half = 0.4 * math.sin(tick / 5)
        for name in people:
            sample = ImuSample(
                stamp_ns=at(time_s),
                orientation_xyzw=(0.0, 0.0, math.sin(half), math.cos(half)),
                angular_velocity_radps=(0.0, 0.0, 1.0) if tick > 3 else None,
            )
            point = None if tick % 7 == 0 else (1.0, 0.1 * tick, 0.0)
            entries.append(said(time_s, topics.IMU, name, sample))
            entries.append(said(time_s, topics.CURSOR, name, Cursor(stamp_ns=at(time_s), point_m=point)))
        heads = tuple(
            TrackedObject(id=name, kind="person_frame", position_m=(index, 2.0, 1.7), yaw_rad=0.5)
            for index, name in enumerate(people)
        )
        cup = (TrackedObject(id="red cup", kind="cup", position_m=(1.0, 2.0, 0.5)),) if tick % 10 else ()
        objects = TrackedObjects(stamp_ns=at(time_s), objects=heads + cup)
        entries.append(said(time_s, topics.OBJECTS, "mocap", objects))
    for name in people:
        pose = UserPose(stamp_ns=at(0.9), position_m=(1.0, 2.0, 0.0), yaw_rad=0.7, method="static_targets")
        chosen = SelectionEvent(
            stamp_ns=at(1.2), event="selected", object_id="red cup", kind="cup", user=name, cause="dwell"
        )
        entries.append(said(0.9, topics.POSE, name, pose))
        entries.append(said(1.2, topics.SELECTION_EVENTS, "", chosen))
        entries.append(said(1.2, topics.HOVER, name, Hover(stamp_ns=at(1.2), object_id="red cup")))
    return sorted(entries, key=lambda each: each.time_ns)
