"""Answers of MQTT brokers after the connection: what they refuse and end is told with a remedy, once."""

import asyncio
import contextlib
import gc
import json
import logging
from collections.abc import AsyncGenerator, Iterator
from pathlib import Path

import aiomqtt
import pytest

from pointit.bridges.agv_tracker.config import AgvTrackerConfig
from pointit.bridges.agv_tracker.service import AgvTracker
from pointit.runtime.clock import WallClock
from pointit.runtime.mqtt.broker import connected, describe_error
from pointit.runtime.mqtt.broker_client import ClosedByBrokerError, RefusedTopicsError
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.runtime.service.service import Launch, run_service
from pointit.schemas import Lamp
from pointit.schemas.topics import HEALTH, MAP
from pointit.services.led_driver.output.mqtt_output import MqttConfig, MqttLamps, find_lamps_on
from pointit.services.led_driver.output.pixel_output import OutputHealth
from pointit.services.robot.drivers.vda5050 import VDA5050, find_agvs_on
from pointit.services.robot.robot_driver import LinkLost, ReportItem
from pointit.testing.trial import TrialHealth
from tests.examples.running import running
from tests.support.bench import memory_bench, until
from tests.support.buses import is_listening
from tests.support.mqtt import broker, overheard
from tests.support.mqtt_things import ROOM, published
from tests.support.old_broker import CONNECT, PUBLISH, SUBSCRIBE, OldBroker
from tests.unit.robot.vda5050.agv_bench import SPEC

PLUGIN = "*/mosquitto_dynamic_security.so"
MAY_NOT_SUBSCRIBE = {
    "defaultACLAccess": {
        "publishClientSend": True,
        "publishClientReceive": True,
        "subscribe": False,
        "unsubscribe": True,
    }
}
LAMPS = tuple(Lamp(id=name, position_m=(0.0, 0.0, 1.0)) for name in ("desk", "door"))
RED = (255, 0, 0)
REFUSES = "the broker does not let clients without a user name subscribe to"
REMEDY = "permit it in the broker's access list"


@pytest.fixture(name="mute_port")
def _mute_port(tmp_path: Path) -> Iterator[int]:
    """Yield the port of a mosquitto whose dynamic security permits nobody to subscribe."""
    (plugin,) = Path("/usr/lib").glob(PLUGIN)
    rights = tmp_path / "rights.json"
    rights.write_text(json.dumps(MAY_NOT_SUBSCRIBE), encoding="utf-8")
    rights.chmod(0o666)
    options = f"allow_anonymous true\nuser root\nplugin {plugin}\nplugin_opt_config_file {rights}\n"
    with broker(tmp_path, options=options) as port:
        yield port


@contextlib.asynccontextmanager
async def lamps_on(port: int, **parameters: object) -> AsyncGenerator[tuple[MqttLamps, TrialHealth]]:
    """Yield a running output, and its health."""
    config = MqttConfig.model_validate({"broker": f"127.0.0.1:{port}", **parameters})
    health = TrialHealth()
    output = MqttLamps(config, OutputHealth(health, config.broker))
    output.set_lamps(LAMPS)
    async with running(output.run()):
        yield output, health


@contextlib.asynccontextmanager
async def steered(port: int) -> AsyncGenerator[list[str]]:
    """Yield the reasons for which a driver of an AGV has no connection to it."""
    values = {"broker": f"127.0.0.1:{port}", "manufacturer": "acme", "serial_number": "7"}
    around = Surroundings(clock=WallClock(), health=TrialHealth(), folder=Surroundings.detached().folder)
    driver = VDA5050.make(VDA5050.config.model_validate(values), SPEC, around)
    reasons: list[str] = []

    def report(item: ReportItem) -> None:
        if isinstance(item, LinkLost):
            reasons.append(item.reason)

    async with running(driver.run(report)):
        yield reasons


async def test_refused_subscriptions_are_reported_to_the_agvs_user(mute_port: int) -> None:
    await until(lambda: is_listening(mute_port), what="the broker")
    async with steered(mute_port) as reasons:
        await until(lambda: any(REFUSES in each for each in reasons), what="the reason")
    reason = next(each for each in reasons if REFUSES in each)
    assert "uagv/v2/acme/7/connection, uagv/v2/acme/7/state" in reason
    assert REMEDY in reason


async def test_refused_subscriptions_of_the_tracker_are_in_its_health(mute_port: int) -> None:
    await until(lambda: is_listening(mute_port), what="the broker")
    config = AgvTrackerConfig(broker=f"127.0.0.1:{mute_port}")
    async with memory_bench(WallClock()) as bench:
        reports = bench.collect(HEALTH, "agv-tracker")
        bench.put(MAP, ROOM)
        launch = Launch(service=AgvTracker, config=config)
        async with running(run_service(launch, bench.bus, bench.clock)):
            await until(lambda: REFUSES in str(reports), what="the warning")
    assert REMEDY in str(reports[-1])


async def test_lamps_light_without_their_availability_and_say_so(mute_port: int) -> None:
    async with lamps_on(mute_port) as (_output, health):
        await until(lambda: REFUSES in str(health.warnings), what="the warning")
    assert "lamps that are off count as online" in str(health.warnings)
    async with OldBroker(refused=("zigbee2mqtt/",)).running() as old, lamps_on(old.port) as (output, health):
        output.show_lamp("desk", RED)
        topics = old.published
        await until(lambda: "zigbee2mqtt/desk/set" in dict(topics), what="a command")
        assert REFUSES in str(health.warnings)


async def test_refused_subscriptions_of_things_are_the_problem_of_their_run(mute_port: int) -> None:
    await until(lambda: is_listening(mute_port), what="the broker")
    async with memory_bench() as bench, published(mute_port, bench) as watcher:
        watcher.on_map(ROOM)
        await until(lambda: REFUSES in watcher.summary()["mqtt"]["problem"], what="the problem")


async def test_a_search_names_a_broker_that_shows_it_nothing(mute_port: int) -> None:
    await until(lambda: is_listening(mute_port), what="the broker")
    for find in (find_lamps_on, find_agvs_on):
        (device,) = await find("127.0.0.1", mute_port, 3.0)
        assert device.label.startswith(f"MQTT broker: {REFUSES}")


async def test_a_broker_of_version_3_refuses_by_its_only_code() -> None:
    async with OldBroker(refused=("b/",)).running() as old:
        options = {"hostname": "127.0.0.1", "port": old.port, "username": "anna"}
        async with connected(options) as client:
            with pytest.raises(RefusedTopicsError) as refusal:
                await client.subscribe([("a/x", 1), ("b/y", 1)])
            await client.publish("a/x", b"1")
    assert str(refusal.value) == f"the broker does not let user anna subscribe to b/y: {REMEDY}"
    assert refusal.value.topics == ("b/y",)
    assert old.published == [("a/x", b"1")]


async def test_denied_commands_are_reported_and_others_go_on(tmp_path: Path) -> None:
    rights = tmp_path / "rights"
    rights.write_text("topic readwrite pointit/#\ntopic readwrite zigbee2mqtt/door/#\ntopic read #\n")
    options = f"allow_anonymous true\nuser root\nacl_file {rights}\n"
    with broker(tmp_path, options=options) as port:
        lamps = lamps_on(port, last_wills=False)
        async with overheard(port, "zigbee2mqtt/door/set") as heard, lamps as (output, health):
            output.show_lamp("desk", RED)
            output.show_lamp("door", RED)
            await until(lambda: bool(heard), what="the command to the other lamp")
            await until(lambda: "commands" in str(health.warnings), what="the warning")
    said = str(health.warnings)
    assert "does not let clients without a user name publish to zigbee2mqtt/desk/set (Not authorized)" in said
    assert "zigbee2mqtt/door/set" not in said


async def test_an_event_that_an_access_list_denies_fails_its_act(tmp_path: Path) -> None:
    rights = tmp_path / "rights"
    rights.write_text("topic read #\n")
    with broker(tmp_path, options=f"allow_anonymous true\nuser root\nacl_file {rights}\n") as port:
        await until(lambda: is_listening(port), what="the broker")
        async with memory_bench() as bench, published(port, bench) as watcher:
            watcher.on_map(ROOM)
            await until(lambda: "publish to" in watcher.summary()["mqtt"]["problem"], what="the problem")


async def test_one_session_per_user_name_is_reported_with_its_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("MQTT_PASSWORD", "sesame")
    passwords = tmp_path / "passwords"
    making = await asyncio.create_subprocess_exec("mosquitto_passwd", "-b", "-c", passwords, "anna", "sesame")
    assert await making.wait() == 0

    options = f"password_file {passwords}\nuse_username_as_clientid true\nuser root\n"
    caplog.set_level(logging.WARNING)
    with broker(tmp_path, options=options) as port:
        await until(lambda: is_listening(port), what="the broker")
        async with lamps_on(port, username="anna") as (_output, health):
            await until(lambda: "last_wills: false" in str(health.warnings), what="the remedy")
            assert "cannot be reached" not in str(health.warnings)
        async with lamps_on(port, username="anna", last_wills=False) as (output, health):
            output.show_lamp("desk", RED)
            await until(lambda: "desk" in output._commands.lit, what="the command")
            assert not health.warnings

    gc.collect()
    assert not [each for each in caplog.records if each.name == "asyncio"]


async def test_a_session_that_another_client_takes_over_is_named() -> None:
    async with OldBroker(takes_over=True).running() as new:
        options = {"hostname": "127.0.0.1", "port": new.port, "identifier": "same"}
        async with connected(options) as first, connected(options):
            with pytest.raises(ClosedByBrokerError, match="another client has taken over the session"):
                await anext(first.messages)


async def ask(port: int) -> None:
    """Subscribe and publish at a broker."""
    async with connected({"hostname": "127.0.0.1", "port": port}) as client:
        await client.subscribe("a/x")
        await client.publish("a/x", b"1")


@pytest.mark.parametrize(
    ("kind", "said"), [(SUBSCRIBE, "had subscribed to a/x"), (PUBLISH, "had published to a/x")]
)
async def test_a_connection_that_is_closed_for_a_topic_names_it(kind: int, said: str) -> None:
    async with OldBroker(closes_after=kind).running() as old:
        with pytest.raises(ClosedByBrokerError, match=said):
            await ask(old.port)


async def test_a_broker_that_never_accepts_is_no_matter_of_topics() -> None:
    async with OldBroker(closes_after=CONNECT).running() as old:
        with pytest.raises(aiomqtt.MqttError) as failure:
            await ask(old.port)
    assert "cannot be reached" in describe_error(failure.value, has_user=False)
