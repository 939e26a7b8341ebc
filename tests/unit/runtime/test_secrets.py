"""Secrets are in no log, health, refusal, parameter or error: one function, at every way out."""

import io
import json
import logging
import sys
import time

import click
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.clock import WallClock
from pointit.runtime.config.config import Config, Layers, published_parameters
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.service.plain_console import PlainConsole
from pointit.runtime.service.process import run_command
from pointit.schemas import Done, SetThing
from pointit.schemas.text import hide_secrets
from pointit.schemas.topics import SERVED, SET_THING
from tests.support.bench import memory_bench, until

SECRET = "hunter2"  # noqa: S105 - of these tests

HIDDEN = {
    f'HTTP Request: POST http://me:{SECRET}@hub/x "200 OK"': 'HTTP Request: POST http://hub/... "200 OK"',
    f"https://hooks.example/services/T0/{SECRET}": "https://hooks.example/...",
    f"open http://192.168.1.7:80/?token={SECRET}, now": "open http://192.168.1.7:80/..., now",
    f"wss://[::1]:80/ws#{SECRET} is lost": "wss://[::1]:80/... is lost",
    f"https://me:pa/{SECRET}@hub/x": "https://***/...",
    f"HTTPS://ME:{SECRET}@HUB": "HTTPS://HUB",
    f"mqtts://me:p@{SECRET}@hub:8883: no answer": "mqtts://***@hub:8883: no answer",
    f"rtsp://{SECRET}@camera/1": "rtsp://***@camera/1",
    f"tls/anna:{SECRET}@hub:7447 is no address": "tls/***@hub:7447 is no address",
    f"anna:{SECRET}@hub": "***@hub",
    f"GET /ws?token={SECRET}&page=1 HTTP/1.1": "GET /ws?token=***&page=1 HTTP/1.1",
    f'{{"api_token": "{SECRET}", "rate": 3}}': '{"api_token": ***, "rate": 3}',
    f"{{'password': b'{SECRET}', 'user': 'anna'}}": "{'password': ***, 'user': 'anna'}",
    f"(got {{'password': '{SECRET}12345...": "(got {'password': ***",
    f"Login(user='anna', passphrase='{SECRET} {SECRET}')": "Login(user='anna', passphrase=***)",
    f"curl --header 'Authorization: Bearer {SECRET}'": "curl --header 'Authorization: ***'",
    f"curl --oauth2-token {SECRET} -v": "curl --oauth2-token *** -v",
    f"[(b'Set-Cookie', b'session={SECRET}; Path=/')]": "[(b'Set-Cookie', b'***')]",
    f"> Cookie: a={SECRET}; b={SECRET}\n> Host: x": "> Cookie: ***\n> Host: x",
    f"X-Api-Key: {SECRET}": "X-Api-Key: ***",
    f"MQTT_PASSWORD={SECRET} pointit run": "MQTT_PASSWORD=*** pointit run",
    f"bearer {SECRET}.abc-def": "bearer ***",
    f"--set a.token_file=eyJhbGciOiJ9.eyJpc3MiOi.{SECRET}: no file": "--set a.token_file=***: no file",
    f"got ['http://hub:8123', 'eyJhbGciOiJ9.eyJpc3MiOi.{SECRET}']": "got ['http://hub:8123', '***']",
}
PLAIN = [
    "http://127.0.0.1:8000/",
    "tcp/127.0.0.1:7447#iface=eth0 is lost",
    "key pointit/home/@may/anna/writes",
    "password_file: /etc/secret cannot be read (no such file or directory)",
    "token: is missing; give it a value",
    "serial:/dev/ttyUSB0 at 115200",
    "key=pointit/home/user/anna/ray",
    "POINTIT_CREDENTIALS: /home/anna/key.pem is readable by others",
    "anna: screws@shelf, 12:30:05",
    "write to a@example.org",
]


@pytest.mark.parametrize(("text", "expected"), HIDDEN.items())
def test_secret_of_any_form_is_hidden_and_the_rest_stays(text: str, expected: str) -> None:
    assert hide_secrets(text) == expected
    assert hide_secrets(expected) == expected


@pytest.mark.parametrize("text", PLAIN)
def test_text_without_secrets_stays(text: str) -> None:
    assert hide_secrets(text) == text


@given(
    st.text(st.characters(codec="ascii", categories=("L", "N")), min_size=4),
    st.sampled_from(
        ["http://u:{}@h/", "http://h/{}", "mqtt://u:{}@h", "token={}", '"password": "{}"', "tcp/u:{}@h"]
    ),
    st.sampled_from(["{}", "x {} y", "({})", "<{}>", "'{}'", "a={}"]),
)
def test_secret_is_hidden_whatever_is_around_it(secret: str, form: str, around: str) -> None:
    marked = f"Q{secret}Q"
    assert marked not in hide_secrets(around.format(form.format(marked)))


@pytest.mark.parametrize(
    "piece", ["://", "token=", "a:", "http://", "authorization:", "'", "bearer ", "a", "--x", "eyJ-"]
)
def test_long_text_of_a_peer_takes_little_time(piece: str) -> None:
    text = piece * (20_000 // len(piece))
    began_s = time.process_time()
    hide_secrets(text + "@h")
    assert time.process_time() - began_s < 2.0


def log_secrets() -> None:
    """Log as libraries do: by arguments, in a traceback and its cause, and with a mistake in the call."""
    for name in ("httpx", "pointit.test", "asyncio"):
        log = logging.getLogger(name)
        log.warning("POST %s", f"http://me:{SECRET}@hub/{SECRET}")
        log.warning("%s and %s", f"token={SECRET}")  # noqa: PLE1206 - the mistake
        try:
            try:
                raise OSError(f"http://hub/{SECRET}")  # noqa: TRY301 - its traceback is the subject
            except OSError as error:
                raise ValueError(f"mqtt://me:{SECRET}@hub") from error
        except ValueError:
            log.exception("failed")


def test_logs_of_all_libraries_and_their_tracebacks_have_no_secret(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    setup_logging("info")
    log_secrets()
    lines = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert len(lines) == 9
    assert SECRET not in stream.getvalue()
    assert lines[0]["message"] == "POST http://hub/..."
    assert "OSError: http://hub/..." in lines[2]["traceback"]
    assert lines[2]["traceback"].endswith("ValueError: mqtt://***@hub")


def test_logs_on_a_terminal_have_no_secret() -> None:
    console = PlainConsole(file=io.StringIO(), force_terminal=True, width=200)
    setup_logging("info", console)
    log_secrets()
    assert isinstance(console.file, io.StringIO)
    text = console.file.getvalue()
    assert SECRET not in text
    assert text.count("ValueError: ") == 3


def test_log_without_setup_contains_no_secret(capsys: pytest.CaptureFixture[str]) -> None:
    logging.getLogger().handlers.clear()
    log_secrets()
    assert "POST http://hub/..." in capsys.readouterr().err
    log_secrets()
    assert SECRET not in capsys.readouterr().err


@pytest.mark.parametrize("kind", [ConfigError, RuntimeError])
def test_error_of_a_command_has_no_secret(kind: type[Exception], capsys: pytest.CaptureFixture[str]) -> None:
    @click.command()
    def fail() -> None:
        raise kind(f"broker: mqtt://me:{SECRET}@hub cannot be used")

    with pytest.raises(SystemExit):
        run_command(fail, [])
    output = capsys.readouterr()
    assert "mqtt://***@hub cannot be used" in output.err
    assert SECRET not in output.err + output.out


class Account(Config):
    name: str
    password: str


class Camera(Config):
    api_token: int = Field(default=0)
    address: str = ""
    headers: dict[str, str] = Field(default_factory=dict[str, str])
    accounts: dict[str, Account] = Field(default_factory=dict[str, Account])
    keys: tuple[str, ...] = ("w", "a")


@pytest.mark.parametrize("value", [SECRET, f"[{SECRET}]", f"{{x: {SECRET}}}", f"[{SECRET}", f"'{SECRET}"])
def test_invalid_secret_is_refused_without_its_value(value: str) -> None:
    def read() -> None:
        layers = Layers()
        layers.add_environment({"POINTIT_CAMERA__API_TOKEN": value}, "POINTIT_CAMERA__")
        layers.build(Camera)

    with pytest.raises(ConfigError, match="POINTIT_CAMERA__API_TOKEN") as caught:
        read()
    assert SECRET not in str(caught.value)


def test_parameters_that_are_published_have_no_secret_at_any_depth() -> None:
    config = Camera(
        api_token=1234,
        address=f"rtsp://me:{SECRET}@hub/1",
        headers={"Authorization": f"Bearer {SECRET}", "Referer": f"http://hub/{SECRET}", "Accept": "any"},
        accounts={"first": Account(name="me", password=SECRET)},
    )
    assert json.loads(published_parameters(config)) == {
        "address": "rtsp://***@hub/1",
        "headers": {"Referer": "http://hub/...", "Accept": "any"},
        "accounts": {"first": {"name": "me"}},
        "keys": ["w", "a"],
    }


async def test_health_and_refusals_have_no_secret() -> None:
    failures: list[Exception] = [ConfigError(f"http://hub/{SECRET}"), ValueError(f"mqtt://me:{SECRET}@hub")]

    async def refuse(_query: SetThing, _name: str) -> Done:
        raise failures.pop()

    async with memory_bench() as bench:
        view = ServiceBus(bench.bus, WallClock(), "camera", "camera")
        told: list[str] = []
        bench.bus.subscribe(SERVED, lambda request, _name: told.append(request.refusal))
        view.warn("hub", f"http://me:{SECRET}@hub/x cannot be reached")
        assert view.report().warnings == ("http://hub/... cannot be reached",)

        view.serve(SET_THING, refuse)
        for expected in ("mqtt://***@hub", "http://hub/..."):
            with pytest.raises(RefusedError) as caught:
                await bench.bus.call(SET_THING, SetThing(thing="lamp", on=True), "anna")
            assert expected in str(caught.value)
            assert SECRET not in str(caught.value)
        await until(lambda: len(told) == 2, what="the requests in the timeline")
        assert SECRET not in "".join(told)
        await view.close()
