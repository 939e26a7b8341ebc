# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false
# (the stubs of zenoh leave return types out)
"""Information that a secured router reveals about itself and others, besides routed messages: none."""

import asyncio
import json

import pytest
import zenoh

from pointit.runtime.zenoh.session import configuration
from tests.faults.account import Account
from tests.faults.attackers import attack, besieged, member
from tests.faults.site import Site
from tests.integration.access.secured import link_of

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

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
