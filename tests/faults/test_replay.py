"""Old messages are put again, by who may write them and by others: no reader takes them for new."""

import asyncio
import time
from collections.abc import Sequence
from dataclasses import dataclass

import pytest
import zenoh
from zenoh.handlers import Callback

from pointit.runtime.bus.timeliness import SILENT_S
from pointit.schemas import Cursor, PointingRay, decode
from pointit.schemas.topics import ANY, BUTTON, CURSOR, IMU, INTERACTION, OBJECTS, POSE, RAY, SELECTION_EVENTS
from tests.faults.account import Account
from tests.faults.attackers import besieged, member
from tests.faults.site import FLOWS_S, NOTICED_S, Site
from tests.faults.witness import Witness, witness
from tests.integration.access.secured import Member
from tests.support.bench import until

RECORDED = (IMU.at("user1"), RAY.at("user1"), CURSOR.at("user1"), SELECTION_EVENTS.at(), OBJECTS.at(ANY))
LATER_S = 3.0
MOST_TAKEN = 0.02
"""Share of the replay, without what came when nothing new had come for `SILENT_S / 2`: a silence makes
readers take what is old, and on a busy machine nothing new may come for a second."""
READERS = ("pointing.user1", "pui", "selector", "led-driver")
pytestmark = [pytest.mark.slow, pytest.mark.long]


@dataclass(frozen=True)
class Recorded:
    at_s: float
    key: str
    payload: bytes
    encoding: zenoh.Encoding


class Recorder:
    def __init__(self, member: Member, keys: Sequence[str] = RECORDED) -> None:
        self.taken: list[Recorded] = []
        take = Callback(self._take, indirect=False)
        self._hears = [member.session.declare_subscriber(key, take) for key in keys]

    def _take(self, sample: zenoh.Sample) -> None:
        key, payload = str(sample.key_expr), bytes(sample.payload)
        self.taken.append(Recorded(time.monotonic(), key, payload, sample.encoding))

    def end(self, last_s: float) -> list[Recorded]:
        for each in self._hears:
            each.undeclare()
        since_s = time.monotonic() - last_s
        return [each for each in self.taken if each.at_s > since_s]


def known(recorded: list[Recorded]) -> set[tuple[int, int]]:
    kinds: dict[str, type[PointingRay | Cursor]] = {RAY.at("user1"): PointingRay, CURSOR.at("user1"): Cursor}
    messages = [
        decode(kinds[each.key], each.payload, kinds[each.key].schema_name())
        for each in recorded
        if each.key in kinds
    ]
    return {(message.stamp_ns, message.seq) for message in messages}


async def play(member: Member, recorded: list[Recorded]) -> None:
    began_s = time.monotonic()
    for each in recorded:
        await asyncio.sleep(max(0.0, each.at_s - recorded[0].at_s - (time.monotonic() - began_s)))
        member.session.put(each.key, each.payload, encoding=each.encoding)


def complains(seen: Witness, instance: str) -> bool:
    return any(
        finding.code == "warning" and "were older than those before them" in finding.sentence
        for finding in seen.findings(instance)
    )


async def test_nobody_takes_a_recording_for_new(site: Site, account: Account) -> None:
    async with witness(site) as seen:
        await seen.begins(site)
        made: list[tuple[float, PointingRay | Cursor]] = []
        seen.bus.subscribe(RAY, lambda ray, _user: made.append((time.monotonic(), ray)), "user1")
        seen.bus.subscribe(CURSOR, lambda cursor, _user: made.append((time.monotonic(), cursor)), "user1")
        before = seen.processes()
        with Member(site.folder, "supervisor") as member:
            recorder = Recorder(member)
            await seen.sees_more_selected()
            await until(lambda: SELECTION_EVENTS.at() in {each.key for each in recorder.taken}, FLOWS_S)
            recorded = recorder.end(last_s=2.0)
            await asyncio.sleep(LATER_S)
            count, selected = len(seen.told()), set(seen.selected)
            made.clear()
            seen.cursors["user1"].clear()
            played_ns, played_s = time.time_ns(), time.monotonic()
            playing = asyncio.create_task(play(member, recorded))
            await until(lambda: all(complains(seen, reader) for reader in READERS), NOTICED_S, "health")
            noticed_s = time.monotonic() - played_s
            await playing
        old = known(recorder.taken)
        new_s, taken = played_s, []
        for at_s, each in made:
            if each.stamp_ns >= played_ns - round(LATER_S * 0.8 * 1e9):
                new_s = at_s
            elif (each.stamp_ns, each.seq) not in old and at_s - new_s < SILENT_S / 2:
                taken.append(each)
        assert len(taken) <= len(recorded) * MOST_TAKEN, "rays and cursors were made of what is old"
        ended_s = time.monotonic()
        await seen.flows()
        await seen.agrees(site)
        assert len(seen.told()) >= count
        await seen.keeps(selected)
        seen.is_undisturbed(before)
        await until(lambda: not any(complains(seen, each) for each in READERS), FLOWS_S, "all to be well")
        account.add(
            f"replay of {len(recorded)} samples, rays, cursors, objects, events",
            noticed_s,
            "health of who reads them: older than before",
            time.monotonic() - ended_s,
            seen.lost_in_words(played_ns) + f"; {len(taken)} taken for new",
        )


VICTIM = "user1"
OLD_S = 2.0
"""Samples of this age are too old."""
FOR_S = 3.0
KEYS = tuple(topic.at(VICTIM) for topic in (IMU, RAY, POSE, INTERACTION, BUTTON))


def say(by: Member, recorded: list[Recorded]) -> None:
    block = zenoh.CongestionControl.BLOCK
    for each in recorded:
        by.session.put(each.key, each.payload, encoding=each.encoding, congestion_control=block)


@pytest.mark.parametrize(
    "name",
    [pytest.param("supervisor", marks=pytest.mark.long), "anna"],  # the former is above, too
)
async def test_old_samples_move_nobodys_cursor(site: Site, account: Account, name: str) -> None:
    async with besieged(site) as attacked:
        with member(site, "supervisor") as spy, member(site, name) as evil:
            recorder = Recorder(spy, KEYS)
            await asyncio.sleep(1.0)
            samples = recorder.end(last_s=1.0)
            await asyncio.sleep(OLD_S)
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
