"""Attackers who write without limit, who read nothing, whose messages are large, random or old."""

import asyncio
import random
import signal
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
from tests.faults.attackers import LARGE, attack, besieged, flooding, keys_of, member, request_keys_of
from tests.faults.site import FLOODERS, FLOWS_S, LONG_WRITER, NOTICED_S, Site
from tests.faults.witness import Witness, witness
from tests.integration.access.secured import Member
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


@pytest.mark.parametrize("what", ["on an own key", "of an own button", "on many keys"])
async def test_a_flood_harms_nobody_and_is_named(site: Site, account: Account, what: str) -> None:
    evil, keys, words = FLOODS[what]
    async with besieged(site) as attacked:
        with flooding(site, evil, RATE_HZ, *keys) as flood:
            await flood.says("begins")
            attacked.begin()
            noticed_s = await attacked.is_told(*words, refused="may not" in words[0])
            await asyncio.sleep(FLOOD_S)
            await until(lambda: attacked.delay_s() < LATE_S, 10, "fresh cursors during the flood")
            late_s = attacked.delay_s()
            rate_hz = flood_rate_hz(flood.out)
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
        late_s = attacked.delay_s()
        growth_mb = attacked.growth_mb()
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
"""The router puts one such message together at a time for each connection, and gives it back."""


async def test_messages_longer_than_any_topic_go_nowhere(site: Site, account: Account) -> None:
    """The supervisor's, whose load has no limit."""
    keys = keys_of(VICTIM)
    requests = request_keys_of(VICTIM)
    large = bytes(LARGE)
    async with besieged(site) as attacked:
        with member(site, "supervisor") as evil:
            attacked.begin()
            attack(evil, keys, large)
            noticed_s = await attacked.is_told("plant/supervisor ", "write such long messages to ")
            for key in requests:
                assert list(evil.session.get(key, payload=large, timeout=5.0)) == []
            # may be by the next report, which has only news
            await attacked.is_told("plant/supervisor ", "ask such long questions of ")
        count = len(keys) + len(requests)
        await until(lambda: attacked.refused_since >= count, 10, f"all {count} to be refused")

        await attacked.unharmed()
        assert attacked.growth_mb() < LARGE_GROWTH_MB
        attacked.row(
            account, "1.5 MB on every key, by who may write it (supervisor)", noticed_s, "doctor: router"
        )


async def test_person_with_long_messages_is_cut_off(site: Site, account: Account) -> None:
    name = LONG_WRITER
    large = bytes(LARGE)
    async with besieged(site) as attacked:
        with member(site, name) as evil:
            attacked.begin()
            attack(evil, keys_of(VICTIM), large)
            noticed_s = await attacked.is_told(f"plant/{name} ", "has written or asked 10000 messages more")
        await attacked.unharmed()
        assert attacked.growth_mb() < LARGE_GROWTH_MB
        attacked.row(
            account, f"1.5 MB on every key, by who may not write it ({name})", noticed_s, "doctor: router"
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
                        ("pui", "users/*/ray"),
                        ("selector", "users/*/cursor"),
                        ("led-driver", "selection"),
                        ("pointing.user1", "users/user1/imu"),
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


RECORDED = (IMU.at("user1"), RAY.at("user1"), CURSOR.at("user1"), SELECTION_EVENTS.at(), OBJECTS.at(ANY))
LATER_S = 3.0
MOST_TAKEN = 0.02
"""Share of the replay, without what came when nothing new had come for `SILENT_S / 2`: a silence makes
readers take what is old, and on a busy machine nothing new may come for a second."""
READERS = ("pointing.user1", "pui", "selector", "led-driver")


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
        key = str(sample.key_expr)
        payload = bytes(sample.payload)
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
            count = len(seen.told())
            selected = set(seen.selected)
            made.clear()
            seen.cursors["user1"].clear()
            played_ns = time.time_ns()
            played_s = time.monotonic()
            playing = asyncio.create_task(play(member, recorded))

            await until(lambda: all(complains(seen, reader) for reader in READERS), NOTICED_S, "health")
            noticed_s = time.monotonic() - played_s
            await playing
        old = known(recorder.taken)
        new_s = played_s
        taken = []
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


OLD_S = 2.0
"""Samples of this age are too old."""
FOR_S = 3.0
KEYS = tuple(topic.at(VICTIM) for topic in (IMU, RAY, POSE, INTERACTION, BUTTON))


def say(by: Member, recorded: list[Recorded]) -> None:
    block = zenoh.CongestionControl.BLOCK
    for each in recorded:
        by.session.put(each.key, each.payload, encoding=each.encoding, congestion_control=block)


@pytest.mark.parametrize("name", ["supervisor", "anna"])
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
                words = "were older than those before them"
                instance = "pui"
            else:
                words = f"plant/{name} may not write "
                instance = "router"
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
