"""The page and a recording in one file: what it plays, and that it is whole."""

import base64
import io
import json
import os
import re
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import msgpack
import pytest
from click.testing import CliRunner

from pointit.bridges.web.playback import page_file as module
from pointit.bridges.web.playback.file_past import FilePast
from pointit.bridges.web.playback.page_file import RATE_HZ, frames, page_file
from pointit.bridges.web.playback.playback import Playback
from pointit.bridges.web.playback.recent import Past
from pointit.cli.page import command
from pointit.recording.reader import Recording
from pointit.runtime.clock import run_virtually
from pointit.runtime.errors import ConfigError
from pointit.schemas import NS_PER_S
from tests.support.recorded import session, write_recording

LENGTH_S = 10.0
"""The simulated person selects a package within this time."""


@pytest.fixture(scope="module")
def past(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Past]:
    path = tmp_path_factory.mktemp("recorded") / "lab.mcap"
    write_recording(path, session("scenario_4", LENGTH_S))
    with Recording.open(path) as recording:
        read = FilePast(recording, "lab")
        run_virtually(read.read())
        yield read


def recording_in(html: str) -> list[Any]:
    found = re.search(r'<script id="recording" type="text/plain"[^>]*>([^<]*)</script>', html)
    assert found is not None
    packed = zlib.decompress(base64.b64decode(found[1]), wbits=31)
    return list(msgpack.Unpacker(io.BytesIO(packed)))


def test_frames_until_an_instant_have_what_a_server_shows_there(past: Past) -> None:
    held: dict[tuple[str, str], bytes] = {}
    events: list[str] = []
    for number, (at_s, states, happened, status) in enumerate(frames(past)):
        for key, name, payload in states:
            if payload is None:
                del held[key, name]
            else:
                held[key, name] = payload
        events += [key for key, _, _ in happened]
        if number % 50 == 0:
            server = Playback(past, 0.0)
            server.seek(past.began_ns + round(at_s * NS_PER_S), 0.0)
            assert held == {news[:2]: news[2] for news in server.model.cache.states_since(0)}, at_s
        assert bool(status) == (number % RATE_HZ == 0), at_s
    entries = [entry.row.key for entry in past.entries(0)]
    assert len(held) > 10
    for key in ("selection/events", "users/{user}/feedback"):
        assert events.count(key) == entries.count(key) > 0


def test_recording_in_which_a_clock_leapt_is_refused(past: Past, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LONGEST_S", LENGTH_S / 2.0)
    with pytest.raises(ConfigError, match="10 s from its first to its last message are too long"):
        page_file(past)


def test_file_has_the_greeting_the_timeline_and_all_frames(past: Past) -> None:
    told: list[float] = []
    hello, timeline, *played = recording_in(page_file(past, told.append))
    greeting = json.loads(hello)
    assert (greeting["site"], greeting["requests"], greeting["deeds"]) == ("lab", [], [])
    length_s = json.loads(timeline)["length_s"]
    assert [each[0] for each in played] == told
    assert told[-1] == length_s == pytest.approx(LENGTH_S, abs=0.1)


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


def test_neither_the_recording_nor_what_is_no_plain_file_is_replaced(tmp_path: Path) -> None:
    recorded = tmp_path / "lab.mcap"
    write_recording(recorded, session("scenario_4", 1.0))
    before = recorded.read_bytes()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    os.mkfifo(tmp_path / "fifo")
    for name in ("lab.mcap", "link", "fifo"):
        arguments = [str(recorded), "--to", str(tmp_path / name), "--overwrite"]
        result = CliRunner().invoke(command, arguments)
        assert "give another file" in str(result.exception), name
    assert recorded.read_bytes() == before
