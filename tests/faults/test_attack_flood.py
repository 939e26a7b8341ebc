"""Attackers who write without limit, or do not read what they requested."""

import asyncio
import signal

import pytest

from pointit.schemas.topics import BUTTON, RAY
from tests.faults.account import Account
from tests.faults.attackers import besieged, flooding
from tests.faults.site import FLOODERS, Site
from tests.support.bench import until
from tests.support.pace import within

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

RATE_HZ = 10_000.0
FLOOD_S = 4.0
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
        attacked.row(
            account, f"a flood {what} ({rate_hz:.0f} Hz)", noticed_s, "doctor: router; its log", lost
        )


def flood_rate_hz(printed: str) -> float:
    count, _, rest = printed.strip().splitlines()[-1].partition(" in ")
    return int(count) / float(rest.removesuffix(" s"))


@pytest.mark.parametrize("names", [("dashboard1", "operator")], ids=["two dashboards"])
async def test_a_reader_that_stands_still_holds_nobody_up(
    site: Site, account: Account, names: tuple[str, ...]
) -> None:
    async with besieged(site) as attacked:
        readers = [site.start("topic", "hz", "--all", name=name) for name in names]
        for reader in readers:
            await until(lambda reader=reader: "Hz" in reader.out or "hz" in reader.out, 20, reader.out)  # type: ignore[misc]
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
