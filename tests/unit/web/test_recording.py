"""The last minute as MCAP: read back by its own reader, bounded, whole."""

import base64
import io
import json
from typing import Any

from mcap.reader import make_reader

from pointit.bridges.foxglove.service import LAYOUT
from pointit.bridges.web.model.recording import LastMinute, file_name
from pointit.schemas import (
    NS_PER_S,
    Cursor,
    Environment,
    Feedback,
    Health,
    Message,
    Selection,
    StripFrame,
    StripsFrame,
    UserPose,
    encode,
)
from pointit.schemas.topics import CURSOR, FEEDBACK, HEALTH, MAP, POSE, SELECTION, STRIPS_FRAME, Topic

START = 1_700_000_000 * NS_PER_S


def at(seconds: float) -> int:
    return START + round(seconds * NS_PER_S)


def add(minute: LastMinute, topic: Topic[Any], message: Message, name: str = "") -> None:
    minute.add(topic, name, message, encode(message), message.stamp_ns)


def read(minute: LastMinute, now_ns: int) -> list[tuple[str, str, int, dict[str, Any]]]:
    """Return topic, schema, log time and fields of what a reader finds."""
    file = io.BytesIO()
    written = minute.recording("lab", now_ns).write(file)
    file.seek(0)
    reader = make_reader(file, validate_crcs=True)
    found = [
        (channel.topic, schema.name if schema else "", message.log_time, json.loads(message.data))
        for schema, channel, message in reader.iter_messages()
    ]
    summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == written == len(found)
    assert all(chunk.compression == "zstd" for chunk in summary.chunk_indexes)
    return found


def cursor(seconds: float, seq: int = 0) -> Cursor:
    return Cursor(stamp_ns=at(seconds), seq=seq, surface="belt", surface_id="b", point_m=(1.0, 2.0, 3.0))


def test_what_is_written_is_read_back_with_its_topic_time_and_fields() -> None:
    minute = LastMinute(60.0)
    add(minute, CURSOR, cursor(1.0), "anna")
    add(minute, FEEDBACK, Feedback(stamp_ns=at(2.0), cue="selected", chime="tick"), "anna")
    add(
        minute, STRIPS_FRAME, StripsFrame(stamp_ns=at(3.0), strips=(StripFrame(id="s", rgb=b"\xff\xfe\x00"),))
    )
    first, second, third = read(minute, at(4.0))
    assert first[:3] == ("/users/anna/cursor", Cursor.schema_name(), at(1.0))
    assert first[3]["point_m"] == [1.0, 2.0, 3.0]
    assert first[3]["stamp_ns"] == at(1.0)
    assert first[3]["origin_m"] is None
    assert second[3]["chime"] == "tick"
    assert base64.b64decode(third[3]["strips"][0]["rgb"]) == b"\xff\xfe\x00"


def test_states_from_before_the_window_are_there_from_its_beginning() -> None:
    minute = LastMinute(10.0)
    add(minute, MAP, Environment(stamp_ns=at(0.0), name="old"))
    add(minute, MAP, Environment(stamp_ns=at(1.0), name="lab"))
    add(minute, POSE, UserPose(stamp_ns=at(2.0), position_m=(1.0, 0.0, 0.0), yaw_rad=0.0), "anna")
    add(minute, CURSOR, cursor(3.0), "anna")
    for second in range(20, 31):
        add(minute, CURSOR, cursor(float(second)), "anna")
    found = read(minute, at(30.0))
    assert [(topic, when) for topic, _, when, _ in found[:3]] == [
        ("/map", at(20.0)),
        ("/users/anna/pose", at(20.0)),
        ("/users/anna/cursor", at(20.0)),
    ]
    assert found[0][3]["name"] == "lab"
    assert len(found) == 13
    minute.forget(POSE, "anna")
    assert "/users/anna/pose" not in {topic for topic, _, _, _ in read(minute, at(30.0))}


def test_what_is_old_goes_even_when_nothing_comes() -> None:
    minute = LastMinute(10.0)
    add(minute, CURSOR, cursor(1.0), "anna")
    add(minute, MAP, Environment(stamp_ns=at(1.0), name="lab"))
    assert [topic for topic, _, _, _ in read(minute, at(60.0))] == ["/map"]
    assert (len(minute), minute.bytes) == (0, 0)
    assert read(LastMinute(60.0), at(0.0)) == []


def test_it_is_bounded_in_number_and_in_bytes() -> None:
    few = LastMinute(60.0, most=5)
    small = LastMinute(60.0, max_bytes=1000)
    for k in range(50):
        add(few, CURSOR, cursor(0.1 * k, k), "anna")
        add(small, CURSOR, cursor(0.1 * k, k), "anna")
    assert [fields["seq"] for _, _, _, fields in read(few, at(5.0))] == [45, 46, 47, 48, 49]
    assert small.bytes <= 1000
    assert 1 <= len(small) < 50


def test_layouts_made_for_live_viewers_fit_a_recording() -> None:
    """The panels of `layout.json` that read topics name them as they are recorded."""
    minute = LastMinute(60.0)
    for user in ("anna", "ben"):
        add(minute, CURSOR, cursor(1.0), user)
    add(minute, SELECTION, Selection(stamp_ns=at(1.0)))
    for service in ("pui", "selector", "led-driver", "conveyor-sim", "pointing.anna"):
        add(minute, HEALTH, Health(stamp_ns=at(1.0), service=service, instance=service, pid=1), service)
    recorded = {topic for topic, _, _, _ in read(minute, at(2.0))}
    assert {"/users/anna/cursor", "/users/ben/cursor", "/health/pointing/anna"} <= recorded
    panels = json.loads(LAYOUT.read_text(encoding="utf-8"))["configById"]
    plotted = {
        path["value"].split('"')[1]
        for name, panel in panels.items()
        if name.startswith("Plot!")
        for path in panel["paths"]
    }
    assert len(plotted) == 4
    shown = {panel["topicPath"] for name, panel in panels.items() if name.startswith("RawMessages!")}
    assert plotted | shown <= recorded


def test_the_files_name_says_of_where_and_when_it_is() -> None:
    assert file_name("lab", START) == "pointit-lab-1700000000.mcap"
