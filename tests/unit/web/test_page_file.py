"""The page and a recording in one file: what it plays, and that it is whole."""

import base64
import io
import json
import re
import zlib
from typing import Any
from urllib.parse import unquote

import msgpack
import pytest

from pointit.bridges.web.model.site_model import SiteModel
from pointit.bridges.web.playback import page_file as module
from pointit.bridges.web.playback.page_file import frames, page_file
from pointit.bridges.web.playback.past import Past, moment
from pointit.bridges.web.playback.playback import Playback
from pointit.bridges.web.playback.recent import Recent
from pointit.recording.entries import Entry, entry
from pointit.runtime.errors import ConfigError
from pointit.runtime.virtual_time import START_NS
from pointit.schemas import NS_PER_S, Environment, Message, SelectionEvent, UserPose, topics

LENGTH_S = 4.0


def entries() -> list[Entry]:
    """Return 4 s of anna, who walks, and ben, who stands and leaves after 2 s; anna selects at 1 s."""
    selected = {"event": "selected", "object_id": "run-7", "kind": "red", "user": "anna"}
    said: list[tuple[float, Any, str, Any, dict[str, Any]]] = [
        (0.0, topics.USER_ALIVE, "anna", True, {}),
        (0.0, topics.USER_ALIVE, "ben", True, {}),
        (0.0, topics.MAP, "", Environment, {"name": "lab"}),
        (0.0, topics.POSE, "ben", UserPose, {"yaw_rad": 0.0, "position_m": (5.0, 0.0, 0.0)}),
        (1.0, topics.SELECTION_EVENTS, "", SelectionEvent, selected),
        (2.0, topics.USER_ALIVE, "ben", False, {}),
    ]
    for tick in range(1, round(LENGTH_S * 50)):
        walked = {"yaw_rad": 0.0, "position_m": (tick / 50, 0.0, 0.0)}
        said.append((tick / 50, topics.POSE, "anna", UserPose, walked))
    made: list[Entry] = []
    for seconds, row, name, kind, fields in sorted(said, key=lambda each: each[0]):
        time_ns = START_NS + round(seconds * NS_PER_S)
        body = kind if isinstance(kind, bool) else kind(stamp_ns=time_ns, **fields)
        made.append(entry(time_ns, row, name, body))
    return made


@pytest.fixture(scope="module")
def past() -> Past:
    recent = Recent("lab")
    model = SiteModel("web", 0.0, recent)
    for each in entries():
        if isinstance(each.row, topics.Topic) and isinstance(each.body, Message):
            model.take(each.row, each.name, each.body, each.time_ns, each.time_ns / NS_PER_S)
        elif isinstance(each.row, topics.Presence) and isinstance(each.body, bool):
            recent.add(each.time_ns, each.row, each.name, each.body, moment(each).payload)
    return recent.past(START_NS + round(LENGTH_S * NS_PER_S))


def recording_in(html: str) -> list[Any]:
    found = re.search(r'<script id="recording" type="text/plain">([^<]*)</script>', html)
    assert found is not None
    packed = zlib.decompress(base64.b64decode(found[1]), wbits=31)
    return list(msgpack.Unpacker(io.BytesIO(packed)))


def test_frames_until_an_instant_have_what_a_server_shows_there(past: Past) -> None:
    held: dict[tuple[str, str], bytes] = {}
    played: list[tuple[float, str]] = []
    number = 0
    for number, (at_s, states, events, status) in enumerate(frames(past)):
        for key, name, payload in states:
            if payload is None:
                del held[key, name]
            else:
                held[key, name] = payload
        played += [(at_s, key) for key, _, _ in events]
        if number % 20 == 0:
            server = Playback(past, 0.0)
            server.seek(past.began_ns + round(at_s * NS_PER_S), 0.0)
            shown = {(key, name): payload for key, name, payload in server.model.hub.states_since(0)}
            assert held == shown, at_s
        assert bool(status) == (number % 30 == 0), at_s
    assert number == pytest.approx(LENGTH_S * 30, abs=1)
    assert [key for _, key in played] == ["selection/events"]
    assert played[0][0] == pytest.approx(1.0, abs=0.04)


def test_file_has_the_greeting_the_timeline_and_all_frames(past: Past) -> None:
    told: list[float] = []
    hello, timeline, *played = recording_in(page_file(past, told.append))
    greeting = json.loads(hello)
    assert (greeting["site"], greeting["requests"], greeting["deeds"]) == ("lab", [], [])
    assert json.loads(timeline)["length_s"] == LENGTH_S
    assert [each[0] for each in played] == told
    assert told[-1] == LENGTH_S


def test_file_loads_nothing(past: Past) -> None:
    html = page_file(past)
    imports = re.search(r'<script type="importmap">(.*?)</script>', html, re.DOTALL)
    assert imports is not None
    modules = {name: unquote(each) for name, each in json.loads(imports[1])["imports"].items()}
    assert len(modules["app.js"]) > 100_000
    named = {name for code in modules.values() for name in re.findall(r'"(\./)?(chunk-\w+\.js)"', code)}
    assert named == {("", name) for name in modules if name != "app.js"}
    rest = html.replace(imports[0], "")
    assert re.findall(r'(?:src|href)="(?!#|data:)[^"]*|url\([^)]*|@import', rest) == []


def test_a_recording_too_long_for_a_page_is_refused(past: Past, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_BYTES", 0)
    with pytest.raises(ConfigError, match=r"limit of 0 MB is reached after 0 s.*--duration"):
        page_file(past)
