"""Strangers at the router's port, and identities that are worth nothing any more."""

import datetime as dt
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
from tests.faults.account import Account
from tests.faults.attackers import attack, besieged, keys_of, new_rules
from tests.faults.site import SITE, Site
from tests.integration.access.secured import Member, endpoint_of, make_site, now, open_with

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
            noticed_s = await attacked.is_told("somebody was not let in", words)
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
