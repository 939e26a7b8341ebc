"""A narrow link with more data than it carries: only the person behind it is late, and not for long."""

import asyncio
import time
from collections.abc import Iterator

import pytest

from pointit.schemas.topics import CURSOR
from tests.faults.account import Account
from tests.faults.network import Host
from tests.faults.network_view import FRESH_S, HERE, PATIENCE_S, THERE, Plant, Spectator, quantile_s, running
from tests.support.bench import until
from tests.support.pace import within

KBIT = 256
WIDE_S = 2.0
NARROW_S = 10.0
LATE_S = 12.0
"""Time that Zenoh's queue and the socket's buffer hold at most, 4 s on a quiet machine."""
RECOVERED_S = 25.0
NOTICED_S = 15.0
GAP_S = 2.0
MEMORY_MB = 30.0


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    """Start two hosts, and lay a cable to a third, once for all tests here."""
    with running(tmp_path_factory.mktemp("narrow")) as started:
        started.network.join("c")
        yield started


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize(
    ("who", "how"),
    [("operator", "by TLS"), pytest.param("dashboard1", "by QUIC, thinned to 20 Hz", marks=pytest.mark.long)],
)
async def test_a_narrow_link_harms_nobody_else(plant: Plant, account: Account, who: str, how: str) -> None:
    wire = plant.network
    c = plant.network.hosts["c"]
    spectator = plant.spectator(c, who)
    async with plant.view() as view:
        await view.flows(HERE, THERE)
        await until(lambda: bool(spectator.lines()), PATIENCE_S, "somebody who looks on at host C")
        wide = await _kbit(plant, c, WIDE_S)
        assert wide > KBIT, "it would not be sent more"

        memory = plant.memory_mb()
        began_s = time.monotonic()
        began_ns = time.time_ns()
        try:
            wire.narrow(c, KBIT)
            narrow = await _kbit(plant, c, NARROW_S)
        finally:
            wire.clear()
        ended_s = time.monotonic()
        late_s = spectator.ages_s(CURSOR.key, began_ns)

        await until(lambda: _newest_s(spectator) < FRESH_S, RECOVERED_S, "the newest at host C")
        recovered_s = time.monotonic() - ended_s
        assert narrow < 2 * KBIT, "the link was not narrow"
        assert late_s, "nothing came any more"
        if who == "operator":
            assert within(max(late_s), LATE_S)
        for user in (HERE, THERE):
            assert within(view.gap_s(user, began_s), GAP_S), f"{user} was disturbed"
            assert within(quantile_s(view.ages_s(user, began_s), 0.5), FRESH_S)

        grown = max(now_mb - memory[name] for name, now_mb in plant.memory_mb().items())
        assert grown < MEMORY_MB
        assert plant.ended() == []
        others = quantile_s(view.ages_s(THERE, began_s), 0.99)
    spectator.command.kill()
    account.add(
        f"{KBIT} kbit/s to who looks on {how}; {wide:.0f} wanted",
        None,
        "",
        recovered_s,
        (
            f"cursors there {quantile_s(late_s, 0.5):.1f} s late, {max(late_s):.1f} s at most after "
            f"{NARROW_S:.0f} s; others' p99 {others * 1e3:.0f} ms"
        ),
        memory_mb=grown,
    )


async def _kbit(plant: Plant, host: Host, for_s: float) -> float:
    before = plant.network.sent_bytes(host)
    began_s = time.monotonic()
    await asyncio.sleep(for_s)
    return (plant.network.sent_bytes(host) - before) * 8e-3 / (time.monotonic() - began_s)


def _newest_s(spectator: Spectator) -> float:
    return spectator.ages_s(CURSOR.key)[-1]
