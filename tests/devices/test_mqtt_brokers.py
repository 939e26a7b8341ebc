"""Genuine MQTT brokers (mosquitto) that refuse a connection: each cause is told with its remedy, once."""

import asyncio
import contextlib
import logging
import ssl
import sys
from collections.abc import AsyncGenerator, Generator
from pathlib import Path
from typing import Any

import pytest
from cryptography.x509.oid import ExtendedKeyUsageOID
from websockets.asyncio.server import ServerConnection, serve
from websockets.typing import Subprotocol

from pointit.bridges.mqtt_things import mqtt_things
from pointit.cli.things.run_things import broker_of
from pointit.runtime.errors import ConfigError
from pointit.runtime.mqtt import broker as broker_errors
from pointit.runtime.mqtt.broker import client_options, connected, describe_error, keep_connected
from pointit.runtime.mqtt.broker_config import BrokerConfig
from pointit.services.led_driver.output.mqtt_output import find_lamps_on
from tests.support.bench import memory_bench, until
from tests.support.buses import free_port, is_listening
from tests.support.certificates import issue
from tests.support.mqtt import broker
from tests.support.mqtt_things import published
from tests.support.tls_servers import REFUSALS, refusing

OPEN = "allow_anonymous true\nuser root\n"


@contextlib.contextmanager
def encrypting(
    folder: Path, host: str = "localhost", more: str = "", **limits: Any
) -> Generator[tuple[int, Path]]:
    """Run a broker with a certificate of its own for `host`. Yield its port and the file of its authority."""
    authority, certificate, key = issue(folder, host, **limits)
    options = f"{OPEN}certfile {certificate}\nkeyfile {key}\n{more}"
    with broker(folder, options=options) as port:
        yield port, authority


@contextlib.asynccontextmanager
async def answering(answer: bytes) -> AsyncGenerator[int]:
    """Run a server that sends `answer` to what is a CONNECT, and nothing else. Yield its port."""
    serving: set[asyncio.Task[None]] = set()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            while data := await reader.read(1000):
                if data[0] == 0x10:
                    writer.write(answer)
        writer.close()
        with contextlib.suppress(OSError):
            await writer.wait_closed()

    def begin(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        serving.add(asyncio.create_task(serve(reader, writer)))

    async with await asyncio.start_server(begin, "127.0.0.1", 0) as server:
        yield server.sockets[0].getsockname()[1]
        await asyncio.gather(*serving)


async def problem(**parameters: Any) -> str:
    """Return the error message for a broker that cannot be connected to, or `""`."""
    config = BrokerConfig.model_validate(parameters)
    await until(lambda: is_listening(config.address()[1]), what="the broker")
    try:
        async with connected(client_options(config)):
            return ""
    except Exception as error:  # noqa: BLE001 - what callers show of any
        return describe_error(error, has_user=bool(config.username))


async def test_brokers_private_authority_is_trusted_by_file_or_variable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with encrypting(tmp_path) as (port, authority):
        url = f"mqtts://localhost:{port}"
        assert await problem(broker=url, ca_file=str(authority)) == ""
        assert await problem(broker=f"localhost:{port}", tls=True, ca_file=str(authority)) == ""
        distrusted = await problem(broker=url)
        monkeypatch.setenv("MQTT_CA_FILE", str(authority))
        assert await problem(broker=url) == ""
        monkeypatch.setenv("MQTT_CA_FILE", str(tmp_path / "broker.log"))
        with pytest.raises(ConfigError, match=r"MQTT_CA_FILE: .*broker.log cannot be used"):
            client_options(BrokerConfig(broker=url))
    assert distrusted.startswith(f"the certificate of the broker at localhost:{port} is not trusted (")
    assert distrusted.endswith("set the variable MQTT_CA_FILE to a file with its authority's certificate")


async def test_certificate_of_the_server_alone_is_trusted_as_ca_file(tmp_path: Path) -> None:
    with encrypting(tmp_path) as (port, _authority):
        assert await problem(broker=f"mqtts://localhost:{port}", ca_file=str(tmp_path / "server.pem")) == ""


async def test_own_authority_passes_the_strict_checks_of_python_3_13(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make = ssl.create_default_context

    def make_strict(**files: Any) -> ssl.SSLContext:
        context = make(**files)
        context.verify_flags |= ssl.VERIFY_X509_STRICT
        return context

    monkeypatch.setattr(ssl, "create_default_context", make_strict)
    with encrypting(tmp_path) as (port, authority):
        assert await problem(broker=f"mqtts://localhost:{port}", ca_file=str(authority)) == ""


@pytest.mark.parametrize(
    ("host", "days", "said"),
    [
        ("localhost", -1.0, ", or of its authority, has expired: renew it there"),
        ("hub.home", 30.0, " is for other names ("),
        ("192.168.1.5", 30.0, " is for other names ("),
    ],
)
async def test_certificate_that_is_not_accepted_is_reported_with_its_fault(
    tmp_path: Path, host: str, days: float, said: str
) -> None:
    with encrypting(tmp_path, host, days=days) as (port, authority):
        text = await problem(broker=f"mqtts://localhost:{port}", ca_file=str(authority))
    assert text.startswith(f"the certificate of the broker at localhost:{port}{said}")


async def test_certificate_for_another_purpose_is_reported_as_unusable(tmp_path: Path) -> None:
    with encrypting(tmp_path, purpose=ExtendedKeyUsageOID.CLIENT_AUTH) as (port, authority):
        text = await problem(broker=f"mqtts://localhost:{port}", ca_file=str(authority))
    assert text.startswith(f"the certificate of the broker at localhost:{port} cannot be used (")
    assert text.endswith("issue another one there")


async def test_connection_by_address_to_a_tls_1_3_broker_succeeds(
    tmp_path: Path,
) -> None:
    with encrypting(tmp_path, "127.0.0.1", more="tls_version tlsv1.3\n") as (port, authority):
        assert await problem(broker=f"mqtts://127.0.0.1:{port}", ca_file=str(authority)) == ""


async def test_encryption_that_only_one_side_uses_is_reported(tmp_path: Path) -> None:
    with encrypting(tmp_path) as (port, _authority):
        plain = await problem(broker=f"localhost:{port}")
    assert f"localhost:{port} encrypts at this port: set `tls` (mqtts:// in front of its address)" in plain
    with broker(tmp_path, options=OPEN) as port:
        secured = await problem(broker=f"mqtts://localhost:{port}")
    assert f"localhost:{port} does not encrypt at this port: leave `tls` out (mqtt://" in secured


@pytest.mark.parametrize("kind", REFUSALS)
async def test_refusal_by_tls_is_named_and_never_answered_by_leaving_tls_out(
    kind: str, tmp_path: Path
) -> None:
    with refusing(tmp_path, kind) as (port, authority):
        text = await problem(broker=f"mqtts://localhost:{port}", ca_file=str(authority))
    assert REFUSALS[kind][1] in text
    assert "leave `tls` out" not in text


async def test_listener_for_websockets_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(broker_errors, "PROBE_TIMEOUT_S", 0.5)
    monkeypatch.setattr(broker_errors, "CONNECT_TIMEOUT_S", 2.0)

    async def listen(websocket: ServerConnection) -> None:
        await websocket.wait_closed()

    async with serve(listen, "127.0.0.1", 0, subprotocols=[Subprotocol("mqtt")]) as server:
        port = next(iter(server.sockets)).getsockname()[1]
        text = await problem(broker=f"127.0.0.1:{port}")
    assert "answers by HTTP, as listeners for websockets do, and PointIt speaks MQTT by TCP: name its" in text


async def test_broker_that_stalls_the_handshake_is_reported_as_unencrypted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(broker_errors, "CONNECT_TIMEOUT_S", 0.5)
    async with answering(b"\x20\x02\x00\x00") as port:
        assert "does not encrypt at this port" in await problem(broker=f"mqtts://127.0.0.1:{port}")


async def test_a_broker_that_asks_for_a_client_certificate_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    more = f"cafile {tmp_path / 'ca.pem'}\nrequire_certificate true\n"
    with encrypting(tmp_path, more=more) as (port, authority):
        text = await problem(broker=f"mqtts://localhost:{port}", ca_file=str(authority))
    assert "asks for a certificate of the client" in text
    assert caplog.messages == [], "the caller logs it, once"


async def test_refused_client_identifier_is_among_the_reported_causes(tmp_path: Path) -> None:
    with broker(tmp_path, options=f"{OPEN}clientid_prefixes home-\n") as port:
        assert "client identifiers that begin with pointit" in await problem(broker=f"localhost:{port}")
    with broker(tmp_path, options=f"{OPEN}clientid_prefixes pointit\n") as port:
        assert await problem(broker=f"localhost:{port}") == ""


@pytest.mark.parametrize(
    ("code", "said"),
    [
        (2, "refuses the client identifier"),
        (3, "cannot be reached"),
        (4, "correct `username` and MQTT_PASSWORD or `password_file`"),
        (5, "allow client identifiers"),
    ],
)
async def test_each_return_code_of_a_broker_has_its_remedy(code: int, said: str) -> None:
    async with answering(bytes((0x20, 2, 0, code))) as port:
        assert said in await problem(broker=f"127.0.0.1:{port}", username="anna")


async def test_a_search_names_a_broker_that_encrypts(tmp_path: Path) -> None:
    with encrypting(tmp_path) as (port, _authority):
        await until(lambda: is_listening(port), what="the broker")
        (found,) = await find_lamps_on("127.0.0.1", port, 5.0)
    assert (found.address, found.label.partition(":")[0]) == (
        f"mqtts://127.0.0.1:{port}",
        "MQTT broker that encrypts",
    )


async def test_repeated_cause_is_logged_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(mqtt_things, "RETRY_S", 0.01)
    tries = 0

    async def counting(serve: Any, on_lost: Any, **options: Any) -> None:
        async def try_once() -> None:
            nonlocal tries
            tries += 1
            await serve()

        await keep_connected(try_once, on_lost, **options)

    monkeypatch.setattr(mqtt_things, "keep_connected", counting)
    caplog.set_level(logging.WARNING)
    async with memory_bench() as bench, published(free_port(), bench):
        await until(lambda: tries > 3, what="the broker to be tried again")
    assert len([text for text in caplog.messages if "cannot be reached" in text]) == 1


async def test_the_command_line_takes_the_authority(tmp_path: Path) -> None:
    with encrypting(tmp_path) as (port, authority):
        await until(lambda: is_listening(port), what="the broker")
        options = ["--no-view", "--no-web", "--duration", "9", "--mqtt", f"mqtts://localhost:{port}"]
        run = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "pointit", "run", "shelf", *options),
            *("--mqtt-ca-file", str(authority)),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
        )
        output, _ = await run.communicate()
    assert b"events published.\n" in output, output.decode()
    assert b"certificate" not in output


@pytest.mark.parametrize(
    "address",
    ["mqtt://anna:sesame@hub", "anna:sesame@hub", "mqtts://anna:sesame@hub:70000", "x://a:sesame@b"],
)
def test_a_password_in_an_address_is_refused_and_not_shown(address: str) -> None:
    with pytest.raises(ConfigError, match=r"--mqtt: broker: write HOST, .* MQTT_PASSWORD") as refusal:
        broker_of(address)
    assert "sesame" not in str(refusal.value)


@pytest.mark.parametrize(
    ("parameters", "address", "tls", "username"),
    [
        ({"broker": "mqtts://anna@hub"}, ("hub", 8883), True, "anna"),
        ({"broker": "mqtt://hub:1884/"}, ("hub", 1884), False, ""),
        ({"broker": "ssl://[::1]"}, ("::1", 8883), True, ""),
        ({"broker": "tcp://hub", "tls": True}, ("hub", 8883), True, ""),
        ({"broker": "mqtts://hub", "tls": False}, ("hub", 8883), True, ""),
        ({"broker": "mqtt://a%40b@hub", "username": "a@b"}, ("hub", 1883), False, "a@b"),
    ],
)
def test_broker_address_may_be_a_url_with_tls_and_user(
    parameters: dict[str, Any], address: tuple[str, int], tls: object, username: str
) -> None:
    config = BrokerConfig.model_validate(parameters)
    assert (config.address(), config.tls, config.username) == (address, tls, username)


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"broker": "mqtt://anna@hub", "username": "ben"}, "different users"),
        ({"broker": "hub", "ca_file": "ca.pem"}, "`ca_file` is for encrypted connections"),
        ({"broker": "ws://hub"}, "MQTT by TCP, not by websockets: name the listener for that"),
        ({"broker": "mqtt://hub/topic"}, "write HOST"),
        ({"broker": "http://hub"}, "write HOST"),
        ({"broker": "mqtt://"}, "write HOST"),
        ({"broker": "hub:70000"}, "write HOST"),
        ({"broker": "hub:0"}, "hub:0: no broker is at port 0: write its port, or the host alone"),
        ({"broker": "mqtts://[::1]:0"}, "no broker is at port 0"),
    ],
)
def test_parameters_of_a_broker_that_contradict_each_other_are_refused(
    parameters: dict[str, Any], said: str
) -> None:
    with pytest.raises(ValueError, match=said):
        BrokerConfig.model_validate(parameters)
