"""Attacks on a secured site: strangers, the revoked, and who writes, answers, is there or reads as others."""

import asyncio
import datetime as dt
import json
import os
import shutil
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
import zenoh

from pointit.access.site_folder import SiteFolder
from pointit.runtime.link.link import Link, read_credentials
from pointit.runtime.link.refusal import connection_refusal
from pointit.runtime.zenoh.session import configuration
from pointit.schemas.topics import (
    ANY,
    CURSOR,
    HEALTH,
    IMU,
    INTERACTION,
    POSE,
    RAY,
    SELECTION,
    SERVICE_ALIVE,
    SET_BRIGHTNESS,
    SET_METHOD,
    SET_POSE,
    USER_ALIVE,
    WRIST,
)
from tests.faults.account import Account
from tests.faults.attackers import ROUTER, attack, besieged, keys_of, member, new_rules, overhearing
from tests.faults.site import SITE, Site
from tests.integration.access.secured import Member, endpoint_of, link_of, make_site, now, open_with
from tests.support.bench import until

pytestmark = pytest.mark.slow

BY = "doctor: router; the router's log"


def garbage(site: Site, _path: Path) -> None:
    with socket.create_connection(("127.0.0.1", site.folder.state().port)) as stranger:
        stranger.sendall(os.urandom(100_000))


def plain(site: Site, _path: Path) -> None:
    port = site.folder.state().port
    with pytest.raises(zenoh.ZError):
        zenoh.open(configuration(Link(site=SITE, connect=(f"tcp/127.0.0.1:{port}",))))


def nameless(site: Site, _path: Path) -> None:
    ca = str(site.folder.identity_folder("anna") / "ca.pem")
    with pytest.raises(zenoh.ZError):
        open_with(Link(connect=(endpoint_of(site.folder),)), {"transport/link/tls/root_ca_certificate": ca})


def foreign(site: Site, path: Path) -> None:
    other = make_site(path / "other", SITE)
    shutil.copy(site.folder.identity_folder("anna") / "ca.pem", other.identity_folder("anna") / "ca.pem")
    _show(other, now(), site)


def expired(site: Site, path: Path) -> None:
    copy = SiteFolder(path / "copy")
    shutil.copytree(site.folder.path, copy.path)
    copy.renew(["anna"], now() - dt.timedelta(days=31))  # it lasts 30 days
    _show(copy, now() - dt.timedelta(days=20), site)


def _show(folder: SiteFolder, at: dt.datetime, site: Site) -> None:
    """Present a certificate to the router, whose clock is another than `at`."""
    credentials = read_credentials(folder.identity_folder("anna"), at)
    assert "refuses anna's certificate" in connection_refusal(credentials, endpoint_of(site.folder))
    with pytest.raises(zenoh.ZError):
        zenoh.open(
            configuration(Link(site=SITE, connect=(endpoint_of(site.folder),), credentials=credentials))
        )


STRANGERS: dict[str, tuple[Callable[[Site, Path], None], str]] = {
    "no certificate": (nameless, "peer sent no certificates"),
    "a certificate of another site": (foreign, "invalid peer certificate"),
    "an expired certificate": (expired, "invalid peer certificate: certificate expired"),
    "plain tcp": (plain, "by plain TCP instead of TLS"),
    "garbage": (garbage, "by plain TCP instead of TLS"),
}


async def test_strangers_are_not_let_in_and_told_of(site: Site, account: Account, tmp_path: Path) -> None:
    async with besieged(site) as attacked:
        for what, (knock, words) in STRANGERS.items():
            folder = tmp_path / what.replace(" ", "-")
            attacked.begin()
            knock(site, folder)
            noticed_s = await attacked.is_told("a connection was refused", words)
            attacked.row(account, f"at the router's port: {what}", noticed_s, BY)
        await attacked.unharmed()


async def test_the_revoked_may_do_nothing_and_are_named(site: Site, account: Account) -> None:
    async with besieged(site) as attacked:
        async with new_rules(site):
            site.folder.add({"mallory": "user"}, now())
        with Member(site.folder, "mallory") as evil:
            async with new_rules(site):
                site.folder.revoke("mallory")
            await attacked.seen.flows()
            attacked.begin()
            noticed_s = await attacked.is_told(
                "plant/mallory may not write ", again=lambda: attack(evil, keys_of("mallory"))
            )
            assert evil.answered("selector/method") == set()
        await attacked.unharmed()
        attacked.row(account, "a revoked identity that is still connected", noticed_s, BY)


EVIL = "anna"
"""May write below her own keys, and read what all may."""
VICTIM = "user1"


async def test_writer_of_forbidden_keys_is_refused_and_named(either_site: Site, account: Account) -> None:
    alien = {key for key in keys_of(VICTIM) if "thing/color" not in key}
    keys = sorted(
        {*alien, SELECTION.at(), HEALTH.at("pui"), HEALTH.at(ROUTER), "surprise", "users/*/pose", "**"}
    )
    async with besieged(either_site) as attacked:
        with (
            member(either_site, "supervisor") as ally,
            member(either_site, EVIL) as evil,
            member(either_site, "dashboard1") as viewer,
        ):
            with overhearing(ally, "**", "**/@adv/**") as heard, ally.listening("**/@may/**") as ear:
                ally.settle(evil)
                attacked.begin()
                attack(evil, keys)
                attack(viewer, keys)
                noticed_s = await attacked.is_told(
                    f"plant/{EVIL} may not write ", "plant/dashboard1 may not write "
                )
                ear.hears(evil.mark())
                ear.hears(viewer.mark())
            assert heard == []

            count = 2 * len(keys)
            await until(lambda: attacked.refused_since >= count, 10, f"all {count} to be refused")
            doctor = either_site.start("doctor", name="operator")
            while doctor.is_running:  # it starts slowly on a busy machine, and reports what is recent
                attack(evil, [POSE.at(VICTIM)])
                await asyncio.sleep(0.2)
        told = await doctor.end()
        assert told.code == 1
        assert f"router: plant/{EVIL} may not write" in " ".join(told.out.split())

        await attacked.unharmed()
        attacked.row(account, "every key written by who may not: another person, a dashboard", noticed_s, BY)


async def test_history_is_written_and_read_by_whom_it_belongs_to(either_site: Site, account: Account) -> None:
    """Below `@adv` writers keep messages for late joiners, which must be neither read nor faked."""
    late = [f"{topic.at(VICTIM)}/@adv/pub/1/2/_" for topic in (POSE, INTERACTION)]
    async with besieged(either_site) as attacked:
        with member(either_site, "supervisor") as ally, member(either_site, EVIL) as evil:
            with overhearing(ally, "**", "**/@adv/**") as heard, ally.listening("**/@may/**") as ear:
                ally.settle(evil)
                attacked.begin()
                attack(evil, late)
                with (
                    evil.serving(f"{POSE.at(VICTIM)}/@adv/**", f"{POSE.at(VICTIM)}/**") as asked,
                    evil.present(f"{POSE.at(VICTIM)}/@adv/pub/1/2/_"),
                ):
                    evil.settle(ally)
                    seen = ally.sees(f"{POSE.at(VICTIM)}/@adv/**")
                    ally.answered(f"{POSE.at(VICTIM)}/@adv/pub/1/2/_")

                assert not any("/pub/1/2" in key for key in seen)
                assert evil.answered(f"{IMU.at(VICTIM)}/@adv/**", f"{RAY.at(VICTIM)}/@adv/**") == set()
                noticed_s = await attacked.is_told(f"plant/{EVIL} may not ", f"write {POSE.at(VICTIM)}")
                await attacked.is_told(f"read {IMU.at(VICTIM)}")
                ear.hears(evil.mark())
            assert (heard, asked) == ([], [])
        await attacked.unharmed()
        attacked.row(account, "another's history, written, answered for, read (`@adv`)", noticed_s, BY)


async def test_answers_and_presence_in_anothers_name_are_refused_and_named(
    either_site: Site, account: Account
) -> None:
    requests = [SET_BRIGHTNESS.at(), SET_METHOD.at(), SET_POSE.at(VICTIM)]
    names = [
        USER_ALIVE.at(VICTIM),
        USER_ALIVE.at("nobody"),
        SERVICE_ALIVE.at("selector"),
        SERVICE_ALIVE.at("pui.x"),
    ]
    async with besieged(either_site) as attacked:
        present = set(attacked.seen.present), set(attacked.seen.people)
        with member(either_site, "operator") as ally, member(either_site, EVIL) as evil:
            attacked.begin()
            with evil.serving(*requests) as asked, evil.present(*names):
                for key in requests:
                    ally.answered(key)
                noticed_s = await attacked.is_told(f"plant/{EVIL} may not ", "answer ", "be present as ")
                assert asked == []
                assert (set(attacked.seen.present), set(attacked.seen.people)) == present
        await attacked.unharmed()
        attacked.row(account, "requests answered and presence told in another's name", noticed_s, BY)


async def test_reader_of_others_movements_is_refused_and_named(either_site: Site, account: Account) -> None:
    private = [topic.at(name) for topic in (IMU, WRIST, RAY) for name in (VICTIM, ANY)]
    async with besieged(either_site) as attacked:
        for name in (EVIL, "dashboard1"):
            with member(either_site, name) as evil, member(either_site, "supervisor") as speaker:
                attacked.begin()
                with evil.listening(*private, "**", "users/**", "users/*/*", CURSOR.at(ANY)) as ear:
                    noticed_s = await attacked.is_told(f"plant/{name} may not ", "read ")
                    ear.hears(CURSOR.at(VICTIM))  # readable for all
                    speaker.put(*keys_of(VICTIM)[:2])
                    ear.keys.clear()
                    ear.hears(CURSOR.at(VICTIM))
                assert not {key for key in ear.keys if key.endswith(("/imu", "/wrist", "/ray"))}, name
                assert evil.answered(*private) == set()
        await attacked.unharmed()
        attacked.row(account, "others' imu, wrist and ray, read by a person and a dashboard", noticed_s, BY)


ADMIN = ("@/**", "@/*/router", "@/*/router/**", "@/*/session/**", "**/@/**")


async def test_the_admin_space_is_closed_and_who_tries_is_named(either_site: Site, account: Account) -> None:
    """Without our client's prefix of every key, as an attacker would ask."""
    config = configuration(link_of(either_site.folder, "anna"))
    config.insert_json5("namespace", "null")
    async with besieged(either_site) as attacked:
        with member(either_site, "anna") as evil, zenoh.open(config) as bare:
            attacked.begin()
            attack(evil, ["@/*/router/config/access_control"])
            bare.put("@/*/router/config/access_control/enabled", b"false")
            assert evil.answered(*ADMIN) == set()

            for key in (*ADMIN, "**"):
                replies = bare.get(key, timeout=3.0, allowed_destination=zenoh.Locality.REMOTE)
                assert [reply for reply in replies if reply.ok is not None] == [], key
            noticed_s = await attacked.is_told("plant/anna may not ", "ask ")
        await attacked.unharmed()
        attacked.row(account, "admin space asked and written", noticed_s, "doctor: router; its log")


async def test_neither_scouting_nor_gossip_find_anybody(either_site: Site, account: Account) -> None:
    """A stranger's scouting, and a person's session that joins as a peer and takes all gossip there is."""
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "true")
    peer = configuration(link_of(either_site.folder, "anna"))
    for key, value in {
        "mode": "peer",
        "scouting/gossip/enabled": True,
        "scouting/gossip/multihop": True,
        "scouting/multicast/enabled": True,
    }.items():
        peer.insert_json5(key, json.dumps(value))
    port = str(either_site.folder.state().port)
    async with besieged(either_site) as attacked:
        attacked.begin()
        scout = zenoh.scout(what="router|peer|client", config=config)
        with zenoh.open(peer) as evil:
            await asyncio.sleep(2.0)  # scouts ask once a second
            found = [hello for hello in iter(scout.try_recv, None) if port in str(hello.locators)]
            assert found == []
            assert len(list(evil.info.peers_zid())) == 0
            assert len(list(evil.info.routers_zid())) <= 1
        scout.stop()
        await attacked.unharmed()
        attacked.row(account, "scouting, gossip as a peer", None, "nothing answers")
