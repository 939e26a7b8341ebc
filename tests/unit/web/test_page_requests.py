"""Requests of pages, and the file of a page."""

import base64
import contextlib
import io
import json
import multiprocessing
import os
import re
import zlib
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import AsyncMock
from urllib.parse import unquote

import msgpack
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, TypeAdapter, ValidationError

from pointit.bridges.web import wire
from pointit.bridges.web.devices import devices
from pointit.bridges.web.devices.devices import update_stored
from pointit.bridges.web.pages.arm_actions import ArmPress, ArmTremor, Speak, SpokenWord, StepBeside
from pointit.bridges.web.pages.page_requests import (
    ACTIONS,
    OPERATORS,
    REQUESTS,
    Call,
    PageAction,
    answer_request,
    hello_of,
    parse_request,
)
from pointit.bridges.web.pages.site_actions import MapEdits
from pointit.bridges.web.playback import page_file as module
from pointit.bridges.web.playback.file_past import FilePast
from pointit.bridges.web.playback.page_file import RATE_HZ, frames, page_file
from pointit.bridges.web.playback.playback import Playback
from pointit.bridges.web.playback.recent import Past
from pointit.bridges.web.wire import Ask, Role
from pointit.cli.page import command
from pointit.maps.edit import edited
from pointit.recording.reader import Recording
from pointit.runtime.errors import ConfigError, PointItError, RefusedError
from pointit.runtime.host.state_file import StateFile
from pointit.runtime.host.store import acquire_lock
from pointit.runtime.virtual_time import run_virtually
from pointit.schemas import NS_PER_S, CancelLocalization, SchemaError, SetSpeed, StopRobot, topics
from pointit.services.registry import SHOWN
from tests.support import there
from tests.support.recorded import session, write_recording

BY_NAME = {action.name: action for action in ACTIONS}
SAID = {"text": "stop", "start_s": 1.0, "end_s": 0.5}


def ask(key: str = "", *, deed: str | None = None, name: str = "", **query: Any) -> Ask:
    return Ask(id=1, key=key, deed=deed, name=name, query=query)


def deeds(role: Role) -> tuple[str, ...]:
    return hello_of(role, version="1", site="lab").deeds


WRIST_DEEDS = ("press", "step", "take", "give", "centre", "report_voice", "speak", "choose_act")


def test_all_roles_that_see_a_robot_may_stop_it() -> None:
    for role in ("operator", "viewer"):
        call = parse_request(ask(topics.STOP_ROBOT.key, name="quad", reason="too near"), role)
        assert call == Call(request=topics.STOP_ROBOT, query=StopRobot(reason="too near"), name="quad")


def test_role_that_cancels_localizations_may_forget_the_bias() -> None:
    wish = ask(topics.CANCEL_LOCALIZATION.key, name="anna", forget_bias=True)
    for role in ("operator", "wrist"):
        call = parse_request(wish, role)
        query = CancelLocalization(forget_bias=True)
        assert call == Call(request=topics.CANCEL_LOCALIZATION, query=query, name="anna")
    with pytest.raises(RefusedError, match="only looks on"):
        parse_request(wish, "viewer")


@pytest.mark.parametrize(
    ("fault", "told"),
    [(RefusedError("it is busy"), "it is busy"), (OSError("no more files"), wire.OWN_FAULT)],
)
async def test_fault_of_the_server_is_answered(
    fault: Exception, told: str, caplog: pytest.LogCaptureFixture
) -> None:
    async def call(*_: Any, **__: Any) -> Any:
        raise fault

    context: Any = SimpleNamespace(bus=SimpleNamespace(call=call))
    answer = await answer_request(context, "page1", "operator", ask(topics.RESET_CONVEYOR.key))
    assert (answer.id, answer.reply, answer.error) == (1, None, told)
    assert ("was not answered" in caplog.text) is isinstance(fault, OSError)
    caplog.clear()


async def test_shared_reply_is_serialized_once(monkeypatch: pytest.MonkeyPatch) -> None:
    reply = wire.SharedReply({"things": ["Lamp", "Box"], "x_m": [0.5]})
    separability = SimpleNamespace(answer=AsyncMock(return_value=reply))
    context: Any = SimpleNamespace(separability=separability)
    dumped: list[Any] = []
    dumps = json.dumps

    def record_and_dump(value: Any, **options: Any) -> str:
        dumped.append(value)
        return dumps(value, **options)

    monkeypatch.setattr(wire.json, "dumps", record_and_dump)
    answers = [await answer_request(context, "page1", "viewer", ask(deed="told_apart")) for _ in range(3)]

    plain = wire.Answer(id=1, reply={"things": ["Lamp", "Box"], "x_m": [0.5]})
    assert [json.loads(answer.json_text()) for answer in answers] == [plain.model_dump(mode="json")] * 3
    assert not [value for value in dumped if "reply" in value or "things" in value]


def test_refusal_is_an_answer_without_a_reply() -> None:
    answer = json.loads(wire.Answer(id=7, error="it is busy").json_text())

    assert (answer["kind"], answer["id"], answer["reply"], answer["error"]) == (
        "answer",
        7,
        None,
        "it is busy",
    )


@pytest.mark.parametrize(
    ("role", "requests", "allowed_deeds", "sentence"),
    [
        ("viewer", (topics.STOP_ROBOT,), ("told_apart",), "only looks on"),
        (
            "wrist",
            (topics.START_LOCALIZATION, topics.CANCEL_LOCALIZATION),
            WRIST_DEEDS,
            "a phone cannot ask for",
        ),
    ],
)
def test_requests_of_viewers_and_phones_are_refused(
    role: Role, requests: tuple[Any, ...], allowed_deeds: tuple[str, ...], sentence: str
) -> None:
    assert (REQUESTS[role], deeds(role)) == (requests, allowed_deeds)
    rows = [row for row in OPERATORS if row not in requests]
    for wish in (
        *(ask(row.key, name="anna" if row.placeholder else "") for row in rows),
        *(ask(deed=deed, name="anna") for deed in deeds("operator") if deed not in allowed_deeds),
    ):
        with pytest.raises(RefusedError, match=sentence):
            parse_request(wish, role)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (ask(topics.SET_SPEED.key, speed_mps=99), "speed_mps"),
        (ask(topics.SET_SPEED.key, speed_mps=1, faster=True), "faster"),
        (ask(topics.SET_SPEED.key, name="anna", speed_mps=1), "takes no name"),
        (ask("no/such"), "pages cannot ask for 'no/such'"),
        (ask(topics.SET_POSE.key, name="anna"), "pages cannot ask for"),  # what calibration sets
        (ask(deed="explode"), "cannot request the action 'explode'; they can request press, step, take"),
        (ask(deed=""), "pages cannot request the action ''"),
        (ask(deed="press", name="anna", gesture="kick"), "gesture"),
        (ask(deed="step", name="anna"), "step: "),
        (ask(deed="speak", name="anna", words=[SAID] * 65), "words"),
        (ask(deed="speak", name="anna", words=[{**SAID, "end_s": float("nan")}]), "end_s"),
        (ask(deed="speak", name="anna", words=[{**SAID, "text": "x" * 65}]), "text"),
        (ask(topics.SET_SPEED.key, deed="press", name="anna"), "one thing at a time"),
    ],
)
def test_malformed_request_is_refused_in_a_sentence(wrong: Ask, sentence: str) -> None:
    with pytest.raises(RefusedError, match=sentence):
        parse_request(wrong, "operator")


@pytest.mark.parametrize("name", ["", "*", "../x", "-x"])
def test_request_name_must_be_valid(name: str) -> None:
    for wish in (ask(topics.UNDO_SELECTION.key, name=name), ask(deed="press", name=name)):
        with pytest.raises((SchemaError, RefusedError)):
            parse_request(wish, "operator")


def test_actions_have_validated_parameters() -> None:
    press = parse_request(ask(deed="press", name="anna", gesture="hold"), "operator")
    assert press == PageAction(action=BY_NAME["press"], user="anna", parameters=ArmPress(gesture="hold"))
    tremor = parse_request(ask(deed="tremor", name="anna", rms_deg=1), "operator")
    assert tremor == PageAction(action=BY_NAME["tremor"], user="anna", parameters=ArmTremor(rms_deg=1.0))
    step = parse_request(ask(deed="step", name="anna", by=-1), "wrist")
    assert step == PageAction(action=BY_NAME["step"], user="anna", parameters=StepBeside(by=-1))


def test_lists_of_a_query_become_tuples_of_its_model() -> None:
    call = parse_request(ask(topics.SET_SPEED.key, speed_mps=1, belts=["a", "b"]), "operator")
    assert isinstance(call, Call)
    assert call.query == SetSpeed(speed_mps=1.0, belts=("a", "b"))
    spoken = parse_request(ask(deed="speak", name="anna", words=[SAID]), "operator")
    assert isinstance(spoken, PageAction)
    assert spoken.parameters == Speak(words=(SpokenWord(text="stop", start_s=1.0, end_s=0.5),))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=10,
)


@given(
    key=st.sampled_from([row.key for row in OPERATORS]) | st.text(max_size=64),
    deed=st.none() | st.sampled_from(sorted(BY_NAME)) | st.text(max_size=64),
    name=st.just("anna") | st.text(max_size=64),
    query=st.dictionaries(
        st.sampled_from(["speed_mps", "belts", "kind", "rms_deg", "gesture", "dwell_s"]) | st.text(),
        JSON,
        max_size=3,
    ),
    role=st.sampled_from(["operator", "viewer", "wrist"]),
)
def test_any_request_is_parsed_or_refused(
    key: str, deed: str | None, name: str, query: dict[str, Any], role: Role
) -> None:
    try:
        meant = parse_request(Ask(id=1, key=key, deed=deed, name=name, query=query), role)
    except PointItError:
        return
    if isinstance(meant, Call):
        assert meant.request in REQUESTS[role]
        assert isinstance(meant.query, meant.request.query)
    else:
        assert role in meant.action.roles
        assert isinstance(meant.parameters, meant.action.parameters)


CLIENT = Path(wire.__file__).with_name("client")
RECEIVED: TypeAdapter[wire.Ack | wire.Ask | wire.AimAt | wire.HeadsetMotion | wire.Play | wire.Turn] = (
    TypeAdapter(wire.Received)
)


@pytest.mark.skipif(not CLIENT.is_dir(), reason="the client's sources are not installed")
def test_client_knows_every_topic_that_it_is_sent() -> None:
    text = CLIENT.joinpath("src", "site", "apply.ts").read_text(encoding="utf-8")
    unseen = re.search(r"type Unseen =(.*?);", text, re.DOTALL)  # tsc sees to all others
    assert unseen
    assert set(re.findall(r'"(.+?)"', unseen[1])) == {topic.key for topic in set(topics.TOPICS) - set(SHOWN)}


@pytest.mark.parametrize(
    "text",
    [
        '{"kind":"hello"}',
        '{"kind":"ack","n":1,"latency_ms":NaN}',
        '{"kind":"aim","user":"anna","at_m":[1,2,1e300]}',
        '{"kind":"aim","user":"a/b","at_m":[1,2,3]}',
        '{"kind":"turn","q":[0,0,0,NaN],"t_ms":0}',
        '{"kind":"turn","q":[0,0,0,1],"t_ms":1e13}',
        '{"kind":"ask","id":1,"deed":1}',
        '{"kind":"play","speed":16}',
        '{"kind":"play","at_s":-1}',
    ],
)
def test_malformed_page_messages_are_rejected(text: str) -> None:
    with pytest.raises(ValidationError):
        RECEIVED.validate_json(text)


def test_lists_in_map_edits_reach_the_file(tmp_path: Path) -> None:
    path = tmp_path / "room.yaml"
    path.write_text("lamps:\n  desk: {position: [1, 2, 0.5]}\n")
    edit = {"op": "set", "section": "lamps", "name": "desk", "key": "position", "value": [1, 2, 0.75]}
    action = parse_request(Ask(id=1, deed="check_map", query={"edits": [edit], "digest": "x"}), "operator")
    assert isinstance(action, PageAction)
    assert isinstance(action.parameters, MapEdits)
    written = edited(path.read_bytes(), action.parameters.edits, path)
    assert written == b"lamps:\n  desk: {position: [1, 2, 0.75]}\n"


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
    found = there(re.search(r'<script id="recording" type="text/plain"[^>]*>([^<]*)</script>', html))
    packed = zlib.decompress(base64.b64decode(found[1]), wbits=31)
    return list(msgpack.Unpacker(io.BytesIO(packed)))


def test_frames_of_a_page_file_match_a_server_throughout(past: Past) -> None:
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


def test_page_file_is_refused_when_a_clock_leapt(past: Past, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LONGEST_S", LENGTH_S / 2.0)
    with pytest.raises(ConfigError, match="10 s from its first to its last message are too long"):
        page_file(past)


def test_page_file_has_greeting_timeline_and_all_frames(past: Past) -> None:
    told: list[float] = []
    hello, timeline, *played = recording_in(page_file(past, told.append))
    greeting = json.loads(hello)
    assert (greeting["site"], greeting["requests"], greeting["deeds"]) == ("lab", [], [])
    length_s = json.loads(timeline)["length_s"]
    assert [each[0] for each in played] == told
    assert told[-1] == length_s == pytest.approx(LENGTH_S, abs=0.1)


def test_page_file_loads_no_other_file(past: Past) -> None:
    html = page_file(past)
    imports = there(re.search(r'<script type="importmap">(.*?)</script>', html, re.DOTALL))
    modules = {name: unquote(each) for name, each in json.loads(imports[1])["imports"].items()}
    assert len(modules["app.js"]) > 100_000
    named = {name for code in modules.values() for name in re.findall(r'"(\./)?(chunk-\w+\.js)"', code)}
    assert named == {("", name) for name in modules if name != "app.js"}
    rest = html.replace(imports[0], "")
    assert re.findall(r'(?:src|href)="(?!#|data:)[^"]*|url\([^)]*|@import', rest) == []


def test_page_file_is_refused_when_the_recording_is_too_long(
    past: Past, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MAX_BYTES", 0)
    with pytest.raises(ConfigError, match=r"limit of 0 MB is reached after 0 s.*--duration"):
        page_file(past)


def test_page_file_replaces_neither_its_recording_nor_special_files(tmp_path: Path) -> None:
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


class Counted(BaseModel):
    count: int = 0


def count_up(path: Path) -> None:
    def add_one(stored: Counted | None) -> Counted:
        return Counted(count=(stored.count if stored else 0) + 1)

    for _ in range(50):
        update_stored(StateFile[Counted].at(path, Counted), add_one)


@pytest.mark.slow
def test_updates_of_two_processes_are_both_stored(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    path = tmp_path / "count.json"
    processes = [context.Process(target=count_up, args=(path,)) for _ in range(2)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
        assert process.exitcode == 0
    assert StateFile[Counted].at(path, Counted).read() == Counted(count=100)


def test_update_fails_when_the_lock_is_held_too_long(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices, "LOCK_TIMEOUT_S", 0.0)
    path = tmp_path / "count.json"
    lock = there(acquire_lock(path.with_suffix(".lock")))
    with contextlib.closing(lock), pytest.raises(ConfigError, match="another process is changing it"):
        update_stored(StateFile[Counted].at(path, Counted), lambda _stored: Counted())
    assert not path.exists()
