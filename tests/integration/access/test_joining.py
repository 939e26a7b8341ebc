"""Admission to a site, and the errors of processes that are refused."""

import asyncio
import contextlib
import datetime as dt
import functools
import os
import shutil
import time
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest
import pytest_asyncio

from pointit.access.rights import LATEST_HZ
from pointit.access.site_folder import SiteFolder
from pointit.runtime.bus.contract import AnyTopic
from pointit.runtime.errors import ConfigError, ConnectError, NoAnswerError
from pointit.runtime.link.link import Link, read_credentials
from pointit.runtime.router import running_router
from pointit.runtime.zenoh import connections
from pointit.runtime.zenoh.session import refusals
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import (
    ButtonEvent,
    Done,
    ImuSample,
    Interaction,
    Message,
    SetBrightness,
    StartLocalization,
    UserProfile,
    topics,
)
from tests.integration.access.secured import (
    credentials_of,
    endpoint_of,
    joined,
    link_of,
    make_site,
    now,
    routed,
)
from tests.support.bench import until
from tests.support.buses import free_port

ROUNDS = 20


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SiteFolder]:
    folder = make_site(tmp_path_factory.mktemp("site") / "lab")
    with routed(folder):
        yield folder


@pytest_asyncio.fixture
async def buses(site: SiteFolder) -> AsyncIterator[dict[str, ZenohBus]]:
    async with contextlib.AsyncExitStack() as stack:
        found: dict[str, ZenohBus] = {}
        for name in ("anna", "guest1", "services", "dashboard1", "operator"):
            found[name] = await ZenohBus.open(link_of(site, name), patience_s=30)
            stack.push_async_callback(found[name].close)
        yield found


async def test_a_person_works_with_the_services(buses: dict[str, ZenohBus]) -> None:
    anna, services, dashboard, operator = (
        buses[name] for name in ("anna", "services", "dashboard1", "operator")
    )
    seen: list[str] = []

    async def start(_query: StartLocalization, name: str) -> Done:
        return Done(message=f"started {name}")

    async def dim(_query: SetBrightness, _name: str) -> Done:
        return Done()

    profile = anna.publisher(topics.PROFILE, "anna")
    profile.put(UserProfile(stamp_ns=1))  # before anybody listens: the history of a late joiner
    anna.announce(topics.USER_ALIVE, "anna")
    anna.serve(topics.START_LOCALIZATION, start, "anna")
    services.serve(topics.SET_BRIGHTNESS, dim)
    services.subscribe(topics.BUTTON, lambda _message, name: seen.append(f"button {name}"))
    dashboard.subscribe(topics.PROFILE, lambda _message, name: seen.append(f"profile {name}"))
    dashboard.watch(topics.USER_ALIVE, lambda name, *, present: seen.append(f"{name} {present}"))
    button = anna.publisher(topics.BUTTON, "anna")

    def everything() -> bool:
        button.put(ButtonEvent(stamp_ns=1))
        return {"button anna", "profile anna", "anna True"} <= set(seen)

    await until(everything, what=f"all of it, of {seen}")
    reply = await operator.call(topics.START_LOCALIZATION, StartLocalization(), "anna")
    assert reply.message == "started anna"
    await operator.call(topics.SET_BRIGHTNESS, SetBrightness(brightness=1))
    with pytest.raises(NoAnswerError, match=r"\(anna\) may not ask leds/brightness"):
        await anna.call(topics.SET_BRIGHTNESS, SetBrightness(brightness=1))
    assert [bus.problem for bus in (anna, services, dashboard, operator)] == [""] * 4


async def test_a_late_joiner_gets_a_living_writers_state(
    site: SiteFolder, buses: dict[str, ZenohBus]
) -> None:
    buses["anna"].publisher(topics.INTERACTION, "anna").put(Interaction(stamp_ns=7, state="idle"))
    await asyncio.sleep(0.2)
    for name in ("dashboard1", "services", "guest1", "supervisor"):
        late = await ZenohBus.open(link_of(site, name), patience_s=30)
        got: list[int] = []
        late.subscribe(topics.INTERACTION, lambda message, _name, got=got: got.append(message.stamp_ns))
        await until(lambda got=got: got == [7], what=f"the state at {name}")
        await late.close()


async def test_service_reports_that_it_may_not_write(
    buses: dict[str, ZenohBus], caplog: pytest.LogCaptureFixture
) -> None:
    guest = buses["guest1"]
    heard: list[str] = []
    for name in ("services", "operator", "anna"):
        buses[name].subscribe(topics.IMU, lambda _message, user: heard.append(user))
    guest.publisher(topics.IMU, "anna").put(ImuSample(stamp_ns=1, orientation_xyzw=(0, 0, 0, 1)))
    guest.publisher(topics.IMU, "guest1")
    await until(lambda: bool(guest.problem), what="the trouble")
    assert guest.problem == (
        "this identity (guest1) may not write users/anna/imu: use credentials of anna, or have them added "
        "with `pointit site user add anna`"
    )
    assert guest.problem in caplog.text
    assert heard == []


async def refused(link: Link) -> str:
    with pytest.raises(ConnectError) as caught:
        await ZenohBus.open(link, patience_s=5)
    return str(caught.value)


async def test_another_site_of_the_same_name_is_refused(site: SiteFolder, tmp_path: Path) -> None:
    foreign = credentials_of(make_site(tmp_path / "lab"), "anna")
    link = Link(site="lab", connect=(endpoint_of(site),), credentials=foreign)
    assert "is not the one of site lab: another authority certified it" in await refused(link)


async def test_a_foreign_certificate_is_refused_by_the_router(site: SiteFolder, tmp_path: Path) -> None:
    foreign = make_site(tmp_path / "lab").identity_folder("anna")
    shutil.copy(site.identity_folder("anna") / "ca.pem", foreign / "ca.pem")
    credentials = read_credentials(foreign, now())
    link = Link(site="lab", connect=(endpoint_of(site),), credentials=credentials)
    assert "of another authority" in await refused(link)


@pytest.mark.parametrize(
    ("made_days", "looked_at_days", "here", "there"),
    [
        (-31, -20, "has expired on", "has expired or is not valid yet, by the router's clock"),  # of 30 days
        (1, 2, r"is not valid before .*set this machine's clock", "has expired or is not valid yet"),
    ],
    ids=["expired", "of tomorrow"],
)
async def test_a_certificate_of_another_time_is_refused_here_and_there(
    site: SiteFolder, tmp_path: Path, *, made_days: int, looked_at_days: int, here: str, there: str
) -> None:
    copy = SiteFolder(tmp_path / "copy")
    shutil.copytree(site.path, copy.path)
    copy.renew(["anna"], now() + dt.timedelta(days=made_days))
    with pytest.raises(ConfigError, match=here):
        credentials_of(copy, "anna")
    credentials = read_credentials(copy.identity_folder("anna"), now() + dt.timedelta(days=looked_at_days))
    link = Link(site="lab", connect=(endpoint_of(site),), credentials=credentials)
    assert there in await refused(link)


async def test_a_router_without_certificates_is_told(site: SiteFolder) -> None:
    port = free_port()
    credentials = credentials_of(site, "anna")
    async with running_router((f"tcp/127.0.0.1:{port}",)):
        link = Link(site="lab", connect=(f"tls/127.0.0.1:{port}",), credentials=credentials)
        assert "is not a router of a secured site" in await refused(link)


async def test_a_server_that_closes_during_the_handshake_is_no_router(site: SiteFolder) -> None:
    """As a router without certificates does, if it is asked by OpenSSL 3.5 or newer."""

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read(65536)
        writer.close()

    async with await asyncio.start_server(answer, "127.0.0.1", 0) as server:
        port = server.sockets[0].getsockname()[1]
        link = Link(site="lab", connect=(f"tls/127.0.0.1:{port}",), credentials=credentials_of(site, "anna"))
        assert "is not a router of a secured site" in await refused(link)


@pytest.mark.parametrize("password", [False, True], ids=["certificates", "passwords"])
async def test_client_waits_while_the_router_opens_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, *, password: bool
) -> None:
    """Its port takes connections and drops them meanwhile."""
    folder = make_site(tmp_path / "lab", password=password)
    door = await asyncio.start_server(lambda _, writer: writer.close(), "127.0.0.1", folder.state().port)
    async with door:
        opening = asyncio.create_task(ZenohBus.open(link_of(folder, "anna"), patience_s=60))
        await until(lambda: opening.done() or "trying again" in caplog.text)
        assert not opening.done()
    with routed(folder):
        bus = await opening
        assert bus.problem == ""
        await bus.close()


async def test_cause_of_a_lost_router_is_probed_until_something_answers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = make_site(tmp_path / "lab")
    asked: list[Link] = []

    def ask(link: Link) -> str:
        asked.append(link)
        return refusals(link)

    monkeypatch.setattr(connections, "SUSPICION_S", 0.05)
    monkeypatch.setattr(connections, "refusals", ask)
    with routed(folder):
        bus = await ZenohBus.open(link_of(folder, "anna"), patience_s=30)
    await until(lambda: bool(asked) and bus.problem != "")  # nobody answers
    door = await asyncio.start_server(lambda _, writer: writer.close(), "127.0.0.1", folder.state().port)
    async with door:
        await until(lambda: "as a router does" in bus.problem or "not a router" in bus.problem)
        await bus.close()


@pytest.mark.skipif(os.name != "posix", reason="modes are POSIX's")
async def test_a_key_that_others_can_read_is_refused(site: SiteFolder, tmp_path: Path) -> None:
    folder = tmp_path / "anna"
    shutil.copytree(site.identity_folder("anna"), folder)
    (folder / "key.pem").chmod(0o640)
    with pytest.raises(ConfigError, match=r"others can read it.*chmod 600 .*key\.pem"):
        read_credentials(folder, now())
    (folder / "key.pem").unlink()
    with pytest.raises(ConfigError, match=r"key\.pem: is missing"):
        read_credentials(folder, now())


def test_too_long_is_dropped_by_the_router(site: SiteFolder) -> None:
    imu = topics.IMU.at("anna")
    button = topics.BUTTON.at("anna")
    with joined(site, "anna", "supervisor") as (anna, supervisor), supervisor.listening("users/**") as ear:
        ear.hears(button, lambda: anna.put(button))
        for size in (topics.IMU.message.max_bytes + 1, 3_000_000, 10_000_000):
            ear.keys.clear()
            anna.put(imu, size=size)
            ear.hears(button, lambda: anna.put(button))
            assert imu not in ear.keys, size
        anna.put(imu, size=topics.IMU.message.max_bytes)
        ear.hears(imu)


def test_dashboards_come_by_quic_and_are_thinned(tmp_path: Path) -> None:
    folder = make_site(tmp_path / "lab", dashboard_rate_hz=10.0)
    assert credentials_of(folder, "dashboard1").link.endpoints[0].startswith("quic/")
    frame = topics.STRIPS_FRAME.at()
    room = topics.MAP.at()
    keys = [topics.CURSOR.at("anna"), topics.CURSOR.at("ben"), frame]
    with (
        routed(folder),
        joined(folder, "dashboard1", "operator", "supervisor") as (dashboard, operator, writer),
        dashboard.listening(topics.CURSOR.at(topics.ANY), frame, room) as thin,
        operator.listening(topics.CURSOR.at(topics.ANY), frame, room) as full,
    ):
        for ear in (thin, full):
            for key in (*keys, room):
                ear.hears(key, functools.partial(writer.put, key))
        for reader, ear in ((dashboard, thin), (operator, full)):
            writer.settle(reader)  # nothing is on its way any more
            ear.keys.clear()
        began_s = time.monotonic()
        for _ in range(300):
            writer.put(*keys)
            time.sleep(2 / LATEST_HZ)
        writer.put(room)  # a state is never thinned, and comes last
        for ear in (thin, full):
            ear.hears(room)

        assert full.keys.count(frame) == 300
        most = 10.0 * (time.monotonic() - began_s) + 2
        assert all(thin.keys.count(key) <= min(most, full.keys.count(key)) for key in keys)


async def test_dashboard_queries_do_not_overtake_the_keys_they_use(tmp_path: Path) -> None:
    """By QUIC with a stream for each priority, every third dashboard's was dropped, and told as too long."""
    folder = make_site(tmp_path / "lab", dashboard_rate_hz=10.0)
    late = f"{topics.DEPLOYMENT.at(topics.ANY)}/@adv/**"
    with (
        routed(folder),
        joined(folder, "services", "supervisor") as (services, witness),
        services.serving(late) as asked,
    ):
        services.settle(witness)
        for rounds in range(1, ROUNDS + 1):
            bus = await ZenohBus.open(link_of(folder, "dashboard1"), patience_s=30)
            bus.subscribe(topics.CLOCK, lambda _message, _name: None)
            bus.subscribe(topics.DEPLOYMENT, lambda _message, _name: None)
            bus.subscribe(topics.HEALTH, lambda _message, _name: None)
            await until(lambda rounds=rounds: len(asked) >= rounds, what=f"question {rounds}")
            await bus.close()


async def test_kept_states_are_for_whoever_may_read_them(
    site: SiteFolder, buses: dict[str, ZenohBus]
) -> None:
    def recall(topic: AnyTopic) -> list[tuple[str, Message]]:
        return [("anna", UserProfile(stamp_ns=5))] if topic is topics.PROFILE else []

    buses["services"].serve_retained([topics.PROFILE], recall)
    for name in ("dashboard1", "anna", "operator"):
        late = await ZenohBus.open(link_of(site, name), patience_s=30)
        got: list[int] = []
        late.subscribe(topics.PROFILE, lambda message, _name, got=got: got.append(message.stamp_ns))
        await until(lambda got=got: got == [5], what=f"the kept state at {name}")
        await late.close()
