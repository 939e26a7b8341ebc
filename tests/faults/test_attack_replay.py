# pyright: reportUnknownMemberType=false
# (the stubs of zenoh leave return types out)
"""Replayed messages, by an identity that may write them, and by another one."""

import asyncio
import time

import pytest
import zenoh
from zenoh.handlers import Callback

from pointit.schemas.topics import BUTTON, IMU, INTERACTION, POSE, RAY
from tests.faults.account import Account
from tests.faults.attackers import besieged, member
from tests.faults.site import Site
from tests.integration.access.secured import Member

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

VICTIM = "user1"
OLD_S = 2.0
"""Samples of this age are too old."""
FOR_S = 3.0
KEYS = tuple(topic.at(VICTIM) for topic in (IMU, RAY, POSE, INTERACTION, BUTTON))


async def captured(by: Member) -> list[zenoh.Sample]:
    """Return the messages under the victim's keys within a second. They are old then."""
    samples: list[zenoh.Sample] = []
    hears = [by.session.declare_subscriber(key, Callback(samples.append, indirect=False)) for key in KEYS]
    await asyncio.sleep(1.0)
    for each in hears:
        each.undeclare()
    await asyncio.sleep(OLD_S)
    return samples


def say(by: Member, samples: list[zenoh.Sample]) -> None:
    for sample in samples:
        by.session.put(
            sample.key_expr,
            sample.payload,
            encoding=sample.encoding,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )


@pytest.mark.parametrize(
    "name",
    [pytest.param("supervisor", marks=pytest.mark.long), "anna"],  # the former is in test_clock_replay, too
)
async def test_old_samples_move_nobodys_cursor(site: Site, account: Account, name: str) -> None:
    async with besieged(site) as attacked:
        with member(site, "supervisor") as spy, member(site, name) as evil:
            samples = await captured(spy)
            assert len(samples) > 10
            attacked.begin()
            if name == "supervisor":  # may write all that; a reader distinguishes old from new
                words, instance = "were older than those before them", "pui"
            else:
                words, instance = f"plant/{name} may not write ", "router"
            noticed_s = await attacked.is_told(words, instance=instance, again=lambda: say(evil, samples))
            ended_s = time.monotonic() + FOR_S
            while time.monotonic() < ended_s:
                say(evil, samples)
                await asyncio.sleep(0.1)
        assert attacked.seen.stale(attacked.began_ns, OLD_S) == 0
        await attacked.unharmed()
        who = "their own writer" if name == "supervisor" else "another person"
        by = f"doctor: {instance}"
        attacked.row(account, f"old samples said again by {who}", noticed_s, by)
