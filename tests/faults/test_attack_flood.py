"""Attackers who write without limit, who read nothing, or whose messages are large or random."""

import asyncio
import random
import signal

import pytest

from pointit.schemas.topics import BUTTON, RAY
from tests.faults.account import Account
from tests.faults.attackers import LARGE, attack, besieged, flooding, keys_of, member, request_keys_of
from tests.faults.site import FLOODERS, Site
from tests.support.bench import until
from tests.support.pace import within

pytestmark = [pytest.mark.slow, pytest.mark.long]
RATE_HZ = 10_000.0
FLOOD_S = 3.0
STUCK_S = 6.0
GROWTH_MB = 60.0
LATE_S = 1.0
"""Five times what a cursor takes on a machine as busy as one that runs other tests beside; a stall is 5 s."""
ONE, TWO, THREE = FLOODERS
FLOODS = {
    "on an own key": (ONE, (RAY.at(ONE),), (f"plant/{ONE} writes {RAY.at(ONE)} ", "times a second")),
    "of an own button": (TWO, (BUTTON.at(TWO),), (f"plant/{TWO} writes {BUTTON.at(TWO)} ", "times a second")),
    "on many keys": (
        THREE,
        tuple(f"users/{THREE}/x{number}" for number in range(2000)),
        (f"plant/{THREE} may not write users/{THREE}/x", " more: refused"),
    ),
}
"""Writer, keys, and the text shown."""


@pytest.mark.parametrize(
    "what", ["on an own key", pytest.param("of an own button", marks=pytest.mark.long), "on many keys"]
)
async def test_a_flood_harms_nobody_and_is_named(site: Site, account: Account, what: str) -> None:
    evil, keys, words = FLOODS[what]
    async with besieged(site) as attacked:
        with flooding(site, evil, RATE_HZ, *keys) as flood:
            await flood.says("begins")
            attacked.begin()
            noticed_s = await attacked.is_told(*words, refused="may not" in words[0])
            await asyncio.sleep(FLOOD_S)
            await until(lambda: attacked.delay_s() < LATE_S, 10, "fresh cursors during the flood")
            late_s, rate_hz = attacked.delay_s(), flood_rate_hz(flood.out)
        await attacked.unharmed()
        assert attacked.growth_mb() < GROWTH_MB
        lost = f"nothing; cursors {1e3 * late_s:.0f} ms old"
        attacked.row(account, f"flood {what} ({rate_hz:.0f} Hz)", noticed_s, "doctor: router; its log", lost)


def flood_rate_hz(printed: str) -> float:
    count, _, rest = printed.strip().splitlines()[-1].partition(" in ")
    return int(count) / float(rest.removesuffix(" s"))


@pytest.mark.parametrize("names", [("dashboard1", "operator")], ids=["two dashboards"])
async def test_a_stopped_reader_holds_nobody_up(site: Site, account: Account, names: tuple[str, ...]) -> None:
    async with besieged(site) as attacked:
        readers = [site.start("topic", "hz", "--all", name=name) for name in names]
        for reader in readers:
            await until(lambda reader=reader: "Hz" in reader.out or "hz" in reader.out, 20, reader.out)
        attacked.begin()
        for reader in readers:
            reader.process.send_signal(signal.SIGSTOP)
        await asyncio.sleep(STUCK_S)
        late_s, growth_mb = attacked.delay_s(), attacked.growth_mb()
        for reader in readers:
            reader.process.send_signal(signal.SIGCONT)
            reader.kill()
        await attacked.unharmed()
        assert within(late_s, LATE_S)
        assert growth_mb < GROWTH_MB
        lost = f"nothing; cursors {1e3 * late_s:.0f} ms old"
        attacked.row(account, "dashboards that stand still for 6 s", None, "nobody: they only look on", lost)


VICTIM = "user1"
LARGE_GROWTH_MB = 150.0
"""The router puts one message of 10 MB together at a time for each connection, and gives it back."""


@pytest.mark.parametrize(
    ("name", "writes", "asks"),
    [
        ("supervisor", "write such long messages to ", "ask such long questions of "),
        pytest.param("dashboard1", "may not write ", "ask ", marks=pytest.mark.long),
        ("anna", "may not write ", "ask "),
    ],
)
async def test_ten_megabytes_go_nowhere(
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
        assert attacked.growth_mb() < LARGE_GROWTH_MB
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
        assert attacked.growth_mb() < LARGE_GROWTH_MB
        by = "doctor: failing, at every reader"
        attacked.row(account, "random bytes on every key, by who may write it", noticed_s, by)
