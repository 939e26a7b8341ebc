"""The last minute as MCAP: read back by another reader, whole."""

import base64
import io
import json
from typing import Any

import pytest
from mcap.reader import make_reader

from pointit.bridges.foxglove.service import LAYOUT
from pointit.bridges.web.playback.recent import Recent
from pointit.bridges.web.server.download import file_name, write_recording
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
from pointit.schemas.topics import (
    CURSOR,
    FEEDBACK,
    HEALTH,
    MAP,
    POSE,
    SELECTION,
    STRIPS_FRAME,
    USER_ALIVE,
    Topic,
)

START = 1_700_000_000 * NS_PER_S


def at(seconds: float) -> int:
    return START + round(seconds * NS_PER_S)


def add(recent: Recent, topic: Topic[Any], message: Message, name: str = "") -> None:
    recent.add(message.stamp_ns, topic, name, message, encode(message))


def read(recent: Recent, now_ns: int, since_ns: int = 0) -> list[tuple[str, str, int, dict[str, Any]]]:
    """Return topic, schema, log time and fields of what a reader finds."""
    file = io.BytesIO()
    past = recent.past(now_ns)
    written = write_recording(past, max(past.began_ns, since_ns), file)
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
    minute = Recent("lab")
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
    minute = Recent("lab")
    minute.add(at(0.0), USER_ALIVE, "anna", True, b"1")
    minute.add(at(0.0), USER_ALIVE, "ben", True, b"1")
    minute.add(at(0.5), USER_ALIVE, "ben", False, b"")
    add(minute, MAP, Environment(stamp_ns=at(0.0), name="old"))
    add(minute, MAP, Environment(stamp_ns=at(1.0), name="lab"))
    add(minute, POSE, UserPose(stamp_ns=at(2.0), position_m=(1.0, 0.0, 0.0), yaw_rad=0.0), "anna")
    add(minute, CURSOR, cursor(3.0), "anna")
    for second in range(20, 31):
        add(minute, CURSOR, cursor(float(second)), "anna")
    found = read(minute, at(30.0), since_ns=at(20.0))
    assert [(topic, when) for topic, _, when, _ in found[:4]] == [
        ("/alive/users/anna", at(20.0)),
        ("/map", at(20.0)),
        ("/users/anna/pose", at(20.0)),
        ("/users/anna/cursor", at(20.0)),
    ]
    assert found[1][3]["name"] == "lab"
    assert len(found) == 14
    minute.forget(POSE, "anna")
    add(minute, CURSOR, cursor(31.0), "anna")
    assert "/users/anna/pose" not in {topic for topic, _, _, _ in read(minute, at(33.0), since_ns=at(32.0))}


def test_what_is_old_is_left_out_even_when_nothing_comes() -> None:
    minute = Recent("lab")
    add(minute, CURSOR, cursor(1.0), "anna")
    add(minute, MAP, Environment(stamp_ns=at(1.0), name="lab"))
    assert [topic for topic, _, _, _ in read(minute, at(60.0), since_ns=at(50.0))] == ["/map"]
    assert read(Recent("lab"), at(0.0)) == []


def test_when_memory_is_short_states_are_there_from_the_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pointit.bridges.web.playback.recent.MAX_BYTES", 2000)
    minute = Recent("lab")
    add(minute, MAP, Environment(stamp_ns=at(0.0), name="lab"))
    for k in range(500):
        add(minute, CURSOR, cursor(0.1 * k, k), "anna")
    found = read(minute, at(50.0))
    assert found[0][0] == "/map"
    assert [fields["seq"] for _, _, _, fields in found[1:]] == list(range(501 - len(found), 500))
    assert 20 <= len(found) < 400


def test_layouts_made_for_live_viewers_fit_a_recording() -> None:
    """The panels of `layout.json` that read topics name them as they are recorded."""
    minute = Recent("lab")
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
