"""Ten megabytes, and random bytes, on every key of the topic table and as every request."""

import random

import pytest

from tests.faults.account import Account
from tests.faults.attackers import LARGE, attack, besieged, keys_of, member, request_keys_of
from tests.faults.site import Site
from tests.support.bench import until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

VICTIM = "user1"
GROWTH_MB = 150.0
"""The router puts one message of 10 MB together at a time for each connection, and gives it back."""


@pytest.mark.parametrize(
    ("name", "writes", "asks"),
    [
        ("supervisor", "write such long messages to ", "ask such long questions of "),
        ("dashboard1", "may not write ", "ask "),
        ("anna", "may not write ", "ask "),
    ],
)
async def test_ten_megabytes_go_no_further_than_the_router(
    site: Site, account: Account, name: str, writes: str, asks: str
) -> None:
    keys, requests, large = keys_of(VICTIM), request_keys_of(VICTIM), bytes(LARGE)
    async with besieged(site) as attacked:
        with member(site, name) as evil:
            attacked.begin()
            attack(evil, keys, large)
            noticed_s = await attacked.is_told(f"plant/{name} ", writes)
            for key in requests:
                assert list(evil.session.get(key, payload=large, timeout=5.0)) == []
            await attacked.is_told(f"plant/{name} ", asks)  # may be by the next report, which has only news
        count = len(keys) + len(requests)
        await until(lambda: attacked.refused_since >= count, 10, f"all {count} to be refused")
        await attacked.unharmed()
        assert attacked.growth_mb() < GROWTH_MB
        may = "may" if name == "supervisor" else "may not"
        attacked.row(
            account, f"10 MB on every key, by who {may} write it ({name})", noticed_s, "doctor: router"
        )


async def test_random_bytes_of_who_may_write_are_dropped_and_counted(site: Site, account: Account) -> None:
    keys = [key for key in keys_of(VICTIM) if not key.startswith("health/")]
    dice = random.Random(1)
    async with besieged(site) as attacked:
        with member(site, "supervisor") as evil:
            attacked.begin()

            def again() -> None:
                attack(evil, keys, dice.randbytes(1000))

            words = "were invalid, and were dropped"
            noticed_s = max(
                [
                    await attacked.is_told(words, key, instance=instance, again=again)
                    for instance, key in (
                        ("pui", "users/{user}/ray"),
                        ("selector", "users/{user}/cursor"),
                        ("led-driver", "selection"),
                        ("pointing.user1", "users/{user}/imu"),
                    )
                ]
            )
            for key in request_keys_of(VICTIM):
                replies = list(evil.session.get(key, payload=dice.randbytes(1000), timeout=5.0))
                assert all(reply.ok is None for reply in replies), key
        await attacked.unharmed()
        assert attacked.growth_mb() < GROWTH_MB
        by = "doctor: failing, at every reader"
        attacked.row(account, "random bytes on every key, by who may write it", noticed_s, by)
