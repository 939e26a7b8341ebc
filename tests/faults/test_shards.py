"""The router between two hosts with a shard each dies while both people dwell on one package."""

import time

import pytest

from pointit.services.selector.shard_engine import NO_ARBITER
from tests.faults.account import Account
from tests.integration.selector.hall import running_hall

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("is_frozen", [False, True], ids=["killed", "stopped and killed"])
async def test_a_router_dies_while_two_hosts_dwell_on_one_package(
    account: Account, *, is_frozen: bool
) -> None:
    async with running_hall() as hall:
        if is_frozen:  # it has the claims of both, and no decision
            hall.router.freeze()
        hall.point()
        claimed = await hall.claims()
        assert claimed or is_frozen, "who is cut off by the frozen router may notice first"
        for person in hall.people:
            person.warnings = ()
        killed_s = time.monotonic()
        await hall.cut()
        await hall.all(lambda person: any(NO_ARBITER in text for text in person.warnings), "the warnings")
        noticed_s = time.monotonic() - killed_s
        began_s = time.monotonic()
        await hall.heal()
        await hall.settled()
        recovered_s = time.monotonic() - began_s
        hall.check()
        account.add(
            f"kill -9 router{' that was stopped' if is_frozen else ''}, two hosts claim one package",
            noticed_s,
            "health of both shards",
            recovered_s,
            "nothing: an owner at most, an event each",
        )
