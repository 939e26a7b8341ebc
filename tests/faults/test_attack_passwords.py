"""A site with passwords: without one, with a wrong or an old one, and places where none must be seen."""

import asyncio
import contextlib
import json
import shutil
import socket
import ssl
import threading
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import pytest

from pointit.access.denied_operations import RECENT_S
from pointit.access.site_folder import SiteFolder
from pointit.runtime.link.link import Link
from pointit.runtime.link.refusal import connection_refusal
from pointit.runtime.zenoh.session import configuration
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas.topics import CURSOR, IMU, POSE, RAY, SET_METHOD, USER_ALIVE
from tests.faults.account import Account
from tests.faults.attackers import (
    PATIENCE_S,
    ROUTER,
    attack,
    besieged,
    is_not_let_in,
    keeps_out,
    keys_of,
    member,
    new_rules,
)
from tests.faults.site import Site
from tests.integration.access.secured import Member, credentials_of, link_of, make_site, now, routed, wait
from tests.support.bench import until
from tests.support.pace import within

pytestmark = [pytest.mark.slow, pytest.mark.long]
BY = "doctor: router; the router's log"
USER = "transport/auth/usrpwd/user"
PASSWORD = "transport/auth/usrpwd/password"  # noqa: S105 - a name of Zenoh's configuration
EVIL = "anna"
VICTIM = "user1"
SILENT = 150
"""More than Zenoh allows to wait at its door by default."""
STRANGER = "a connection was refused"
LATE_S = 1.0
"""Limit of the time without any person's cursor, on a busy machine."""


def refused(folder: SiteFolder, name: str, **settings: object) -> None:
    """Connect with other settings than the person's. Fail if that is accepted."""
    config = configuration(link_of(folder, name))
    for key, value in settings.items():
        config.insert_json5({"user": USER, "password": PASSWORD}[key], json.dumps(value))
    is_not_let_in(config)


def behind_tls(folder: SiteFolder) -> ssl.SSLSocket:
    """Return a connection of a stranger who has only the authority's certificate, which is no secret."""
    context = ssl.create_default_context(cafile=folder.identity_folder(EVIL) / "ca.pem")
    plain = socket.create_connection(("127.0.0.1", folder.state().port), timeout=10)
    return context.wrap_socket(plain, server_hostname="127.0.0.1")


def garbage(folder: SiteFolder) -> None:
    with behind_tls(folder) as stranger:
        stranger.sendall(b"\x05\x00hello")
        with contextlib.suppress(OSError):
            stranger.recv(1)  # until it is thrown out


def plain(folder: SiteFolder) -> None:
    is_not_let_in(configuration(Link(connect=(f"tcp/127.0.0.1:{folder.state().port}",))))


STRANGERS: dict[str, tuple[Callable[[SiteFolder], None], str]] = {
    "a wrong password": (
        lambda folder: refused(folder, EVIL, password="wrong"),  # noqa: S106
        "a wrong password from 127.0.0.1",
    ),
    "a wrong password by QUIC": (
        lambda folder: refused(folder, "dashboard1", password="wrong"),  # noqa: S106
        "a wrong password from 127.0.0.1",
    ),
    "the own password with another's name": (
        lambda folder: refused(folder, EVIL, user="plant/ben/1"),
        "a wrong password from 127.0.0.1",
    ),
    "an unknown name": (
        lambda folder: refused(folder, EVIL, user="plant/mallory/1"),
        "an unknown or former password from 127.0.0.1",
    ),
    "no password": (
        lambda folder: refused(folder, EVIL, user=None, password=None),
        "came without a password from 127.0.0.1",
    ),
    "garbage behind TLS": (garbage, "came by TLS and spoke no Zenoh from 127.0.0.1"),
    "plain tcp": (plain, "by plain TCP instead of TLS"),
}


async def test_nobody_who_is_let_in_is_told_of(password_site: Site) -> None:
    """The first test here, as it waits until the reports of others about strangers are over."""
    async with besieged(password_site) as attacked:
        health = attacked.seen.health
        await until(
            lambda: STRANGER not in attacked.shown(), RECENT_S + PATIENCE_S, "strangers to be forgotten"
        )
        with contextlib.ExitStack() as stack:
            for name in (EVIL, "dashboard1"):  # by TLS and by QUIC
                await asyncio.to_thread(stack.enter_context, member(password_site, name))
            later = health[ROUTER].seq + 2  # the next may have been on its way before
            await until(lambda: health[ROUTER].seq >= later, PATIENCE_S, "the router to report")
            assert STRANGER not in attacked.shown()


async def test_client_without_a_password_is_refused(password_site: Site, account: Account) -> None:
    async with besieged(password_site) as attacked:
        for what, (knock, words) in STRANGERS.items():
            attacked.begin()
            come = partial(knock, password_site.folder)
            await asyncio.to_thread(come)
            noticed_s = await attacked.is_told(STRANGER, words, again=come)
            attacked.row(account, f"at the router's port: {what}", noticed_s, BY)
        await attacked.unharmed()


async def test_silent_clients_do_not_keep_others_out(password_site: Site, account: Account) -> None:
    async with besieged(password_site) as attacked:
        attacked.begin()
        with contextlib.ExitStack() as stack:

            def come() -> None:
                for _ in range(SILENT):
                    stack.enter_context(behind_tls(password_site.folder))
                stack.enter_context(member(password_site, "ben"))

            await asyncio.to_thread(come)  # the loop, which receives cursors, goes on meanwhile
            noticed_s = await attacked.is_told(STRANGER, "came by TLS and said nothing")
            await attacked.unharmed()
        assert within(attacked.longest_silence_s(), LATE_S)  # 3 s where closing each of them is waited for
        attacked.row(account, f"at the router's port: {SILENT} who say nothing", noticed_s, BY)


async def test_a_right_password_opens_nobody_elses_door(password_site: Site, account: Account) -> None:
    """The rules are those of certificates; all attacks on them are made where there is more time."""
    late = f"{POSE.at(VICTIM)}/@adv/pub/1/2/_"
    async with besieged(password_site) as attacked:
        with (
            member(password_site, EVIL) as evil,
            member(password_site, EVIL) as twin,
            member(password_site, "dashboard1") as viewer,
        ):
            attacked.begin()
            for who in (evil, viewer):
                attack(who, [*keys_of(VICTIM), late])
                assert who.answered(SET_METHOD.at()) == set()
            with (
                evil.present(USER_ALIVE.at(VICTIM)),
                viewer.listening(IMU.at(VICTIM), RAY.at(VICTIM), CURSOR.at(VICTIM)) as ear,
                twin.listening(f"users/{EVIL}/pose") as twins,
            ):
                noticed_s = await attacked.is_told(
                    f"plant/{EVIL} may not write ",
                    "be present as ",
                    "plant/dashboard1 may not write ",
                    "read ",
                )
                ear.hears(CURSOR.at(VICTIM))
                assert set(ear.keys) == {CURSOR.at(VICTIM)}

                # a twin shares their name, and is unharmed too
                twins.hears(POSE.at(EVIL), lambda: evil.put(POSE.at(EVIL)))
        await attacked.unharmed()
        attacked.row(account, "a right password and others' keys; twice at a time", noticed_s, BY)


async def test_an_old_password_is_refused_and_told_of(
    password_site: Site, account: Account, tmp_path: Path
) -> None:
    folder = password_site.folder
    async with besieged(password_site) as attacked, contextlib.AsyncExitStack() as stack:
        async with new_rules(password_site):
            folder.add({"mallory": "user", "eve": "user"}, now())
        old = SiteFolder(tmp_path / "old")
        shutil.copytree(folder.path, old.path)
        bus = await ZenohBus.open(link_of(folder, "mallory"), patience_s=20)
        stack.push_async_callback(bus.close)
        attacked.begin()
        async with new_rules(password_site):
            folder.renew(["mallory"], now())

        noticed_s = await attacked.is_told("an unknown or former password from 127.0.0.1")
        attacked.row(account, "a replaced password, by who was connected", noticed_s, BY)
        await until(lambda: "refuses mallory's password" in bus.problem, 10, "the process to know why")

        await asyncio.to_thread(keeps_out, link_of(old, "mallory"), rightful=link_of(folder, "mallory"))
        with Member(folder, "eve") as evil:
            attacked.begin()
            async with new_rules(password_site):
                folder.remove("eve")
            come = partial(is_not_let_in, configuration(link_of(old, "eve")))  # she may not do so by herself
            noticed_s = await attacked.is_told("an unknown or former password from 127.0.0.1", again=come)
            await until(lambda: not list(evil.session.info.routers_zid()), what="eve to be cut off")
        await asyncio.to_thread(keeps_out, link_of(old, "eve"), rightful=link_of(folder, EVIL))
        await bus.close()
        await attacked.unharmed()
        attacked.row(account, "a removed person's password, by who was connected", noticed_s, BY)


async def test_no_password_is_seen_where_it_does_not_belong(password_site: Site) -> None:
    """In nothing that is printed, logged or kept, in no process's arguments or variables."""
    site = password_site
    lines = (site.folder.path / "router" / "users.txt").read_text().splitlines()
    secrets = [line.rpartition(":")[2].encode() for line in lines]
    assert all(len(secret) > 30 for secret in secrets)

    async with besieged(site):
        operator = {**site.environment("operator"), "RUST_LOG": "trace"}
        commands = [
            site.commands.start_program(*arguments, environment=operator)
            for arguments in (
                ("doctor", "--json"),
                ("site", "show", "--json", "--folder", str(site.folder.path)),
            )
        ]
        for command in commands:
            assert (await command.end()).out
        assert site.run is not None

        family = [*site.run.family(), *site.router.family()]
        seen = {f"{process.pid}: {process.cmdline()}": str(process.cmdline()).encode() for process in family}
        seen |= {f"{process.pid}: variables": str(process.environ()).encode() for process in family}
        for file in site.path.rglob("*"):
            belongs = site.folder.path in file.parents and file.name in ("password", "users.txt")
            if file.is_file() and not belongs:
                with contextlib.suppress(FileNotFoundError):  # renamed meanwhile
                    seen[str(file)] = file.read_bytes()
    assert len(family) > 10
    assert [where for where, what in seen.items() if any(secret in what for secret in secrets)] == []


def test_fake_router_gets_no_password(tmp_path: Path) -> None:
    """By TCP, and by QUIC, where a router of another authority even knows all passwords."""
    folder = make_site(tmp_path / "lab", password=True, dashboard_rate_hz=20.0)
    other = make_site(tmp_path / "other" / "lab", password=True, dashboard_rate_hz=20.0)
    shutil.copy(folder.path / "router" / "users.txt", other.path / "router" / "users.txt")
    for name in (EVIL, "dashboard1"):  # identities that trust the other authority are accepted there
        shutil.copy(folder.identity_folder(name) / "password", other.identity_folder(name) / "password")
    with pretending(other) as pretender:
        endpoint = f"tls/127.0.0.1:{pretender.port}"
        come = partial(is_not_let_in, configuration(_link(folder, EVIL, endpoint)))
        wait(lambda: any("ALERT" in why for why in pretender.failed), "somebody to mistrust it", come)
        assert "another authority certified it" in connection_refusal(credentials_of(folder, EVIL), endpoint)

    assert pretender.trusted == []
    with routed(other):
        for name, protocol in (("dashboard1", "quic"), (EVIL, "tls")):
            endpoint = f"{protocol}/127.0.0.1:{other.state().port}"
            keeps_out(_link(folder, name, endpoint), rightful=_link(other, name, endpoint))


def _link(folder: SiteFolder, name: str, endpoint: str) -> Link:
    return Link(site="lab", connect=(endpoint,), credentials=credentials_of(folder, name))


MESSAGE_S = 5.0
"""Time to wait for the next message of a connection."""


@dataclass
class Pretender:
    port: int
    trusted: list[bytes] = field(default_factory=list[bytes])
    """First message of each client that trusted it."""
    failed: list[str] = field(default_factory=list[str])
    """Error of each other client."""


@contextlib.contextmanager
def pretending(folder: SiteFolder) -> Generator[Pretender]:
    """Listen as a router, by TLS, with the certificate of the site in `folder`."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    router = folder.path / "router"
    context.load_cert_chain(router / "cert.pem", router / "key.pem")
    with socket.create_server(("127.0.0.1", 0)) as server:
        pretender = Pretender(server.getsockname()[1])

        def serve() -> None:
            while True:
                try:
                    came, _ = server.accept()
                except OSError:  # the end
                    return
                with came:
                    came.settimeout(MESSAGE_S)
                    try:
                        _hear(came)
                    except OSError as error:  # each their own way to go: an alert, a reset, silence
                        pretender.failed.append(str(error))

        def _hear(came: socket.socket) -> None:
            with context.wrap_socket(came, server_side=True, do_handshake_on_connect=False) as secured:
                secured.do_handshake()
                said = b""  # nothing, if it fails from here on: the certificate was taken all the same
                try:
                    said = secured.recv(1000)
                finally:
                    pretender.trusted.append(said)

        thread = threading.Thread(target=serve, name="pretender")
        thread.start()
        try:
            yield pretender
        finally:
            server.shutdown(socket.SHUT_RDWR)
            thread.join()
