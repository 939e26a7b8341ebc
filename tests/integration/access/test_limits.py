"""Limits of one identity at a router: number of connections, and delays that it causes for others."""

import asyncio
import contextlib
import functools
import itertools
import json
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import zenoh
from zenoh.handlers import Callback

from pointit.access.connection_limits import MAX_CONNECTIONS
from pointit.access.rights import LATEST_HZ, MAX_RATE_HZ, viewer_topics
from pointit.access.router_configuration import MAX_HISTORY_HZ, configuration
from pointit.access.site_folder import SiteFolder
from pointit.diagnosis.diagnose import diagnose
from pointit.diagnosis.observation import DiagnosisReport, Observation
from pointit.runtime.errors import PointItError
from pointit.runtime.router import Router
from pointit.runtime.zenoh.session import LINGER, own_sockets
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import ButtonEvent, Health, ReadHistory, ReadHistoryReply, UserPose, decode
from pointit.schemas.problems import EXCESS
from pointit.schemas.topics import BUTTON, CURSOR, HEALTH, POSE, PRESENCES, RAY, READ_HISTORY, USER_ALIVE
from tests.faults.attackers import DECLARATIONS
from tests.integration.access.secured import Member, RouterProgram, link_of, make_site, now, routed, wait
from tests.support.bench import until

STALL_S = 4.0
"""A router that waits for a reader does so for 5 s, over and over."""
WRITERS = 4
"""More than the threads by which a router reads."""
LARGE = bytes(16_000)


@pytest.fixture
def folder(tmp_path: Path) -> SiteFolder:
    return make_site(tmp_path / "site")


@contextmanager
def stuck(reader: Member, key: str) -> Generator[None]:
    """Have `reader` ask for `key` and take nothing of it while inside."""
    end = threading.Event()

    def wait_for_the_end(_: zenoh.Sample) -> None:
        end.wait()

    subscriber = reader.session.declare_subscriber(key, Callback(wait_for_the_end, indirect=False))
    try:
        yield
    finally:
        end.set()
        subscriber.undeclare()


@contextmanager
def writing(writers: list[Member], key: str) -> Generator[None]:
    """Have each of `writers` write `key` 500 times a second and insist that nothing is dropped."""
    end = threading.Event()

    def write(session: zenoh.Session) -> None:
        while not end.wait(0.002):
            session.put(key, LARGE, congestion_control=zenoh.CongestionControl.BLOCK)

    threads = [threading.Thread(target=write, args=(writer.session,)) for writer in writers]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        end.set()
        for thread in threads:
            thread.join(30)


def longest_gap_s(writer: Member, reader: Member, for_s: float) -> float:
    """Return for how long, at most, nothing of what `writer` writes comes to `reader`."""
    came_s = [time.monotonic()]
    key = CURSOR.at("user1")

    def hear(_: zenoh.Sample) -> None:
        came_s.append(time.monotonic())

    subscriber = reader.session.declare_subscriber(key, Callback(hear, indirect=False))
    wait(lambda: len(came_s) > 3, "cursors", lambda: writer.put(key))
    end_s = time.monotonic() + for_s
    while time.monotonic() < end_s:
        writer.session.put(key, b"x", congestion_control=zenoh.CongestionControl.DROP)
        time.sleep(0.01)
    came_s.append(time.monotonic())
    subscriber.undeclare()
    return max(after - before for before, after in itertools.pairwise(came_s))


@pytest.mark.long  # saturates both cores: beside other jobs it measures the machine, not the router
def test_stuck_reader_and_insistent_writers_hold_nobody_up(folder: SiteFolder) -> None:
    with RouterProgram("--site-folder", str(folder.path)), ExitStack() as stack:
        ally, onlooker, reader, *writers = (
            stack.enter_context(Member(folder, name))
            for name in ("supervisor", "operator", *("anna",) * (WRITERS + 1))
        )
        with stuck(reader, RAY.at("anna")), writing(writers, RAY.at("anna")):
            assert longest_gap_s(ally, onlooker, 8.0) < STALL_S


def test_router_drops_instead_of_waiting_whatever_a_writer_wants(folder: SiteFolder) -> None:
    """The same configuration as zenohd's: nothing of `pointit router` is around it."""
    heard: list[bool] = []

    def hear(sample: zenoh.Sample) -> None:
        heard.append(sample.congestion_control == zenoh.CongestionControl.DROP)

    with routed(folder), Member(folder, "anna") as anna, Member(folder, "operator") as operator:
        subscriber = operator.session.declare_subscriber(BUTTON.at("anna"), Callback(hear, indirect=False))
        wait(lambda: bool(heard), "a button", lambda: anna.put(BUTTON.at("anna")))
        subscriber.undeclare()
    assert all(heard)


def test_writes_above_the_rate_of_a_key_reach_nobody(folder: SiteFolder) -> None:
    button, cursor, pose = (topic.at("anna") for topic in (BUTTON, CURSOR, POSE))
    with (
        routed(folder),
        Member(folder, "anna") as anna,
        Member(folder, "services") as services,
        services.listening(button, cursor, pose) as ear,
    ):
        began_s = time.monotonic()  # some of the first may come after they are forgotten
        for key in (button, cursor):
            ear.hears(key, functools.partial(anna.put, key))
        ear.keys.clear()
        for _ in range(3000):
            anna.put(button, cursor)
        ear.hears(pose, functools.partial(anna.put, pose))
        took_s = time.monotonic() - began_s

        assert ear.keys.count(button) <= MAX_RATE_HZ * took_s + 2
        assert ear.keys.count(cursor) <= LATEST_HZ * took_s + 2


async def test_burst_loses_neither_events_nor_the_newest_state(folder: SiteFolder) -> None:
    """Zenoh drops what follows too soon; readers fetch it again."""
    count = 0
    burst = 20
    buttons: list[int] = []
    poses: list[int] = []
    with routed(folder):
        anna = await ZenohBus.open(link_of(folder, "anna"), patience_s=30)
        services = await ZenohBus.open(link_of(folder, "services"), patience_s=30)
        heard = services.subscribe(BUTTON, lambda button, _user: buttons.append(button.seq))
        services.subscribe(POSE, lambda pose, _user: poses.append(pose.seq))
        button = anna.publisher(BUTTON, "anna")
        pose = anna.publisher(POSE, "anna")

        def press() -> None:
            nonlocal count
            count += 1
            button.put(ButtonEvent(stamp_ns=time.time_ns(), seq=count))
            pose.put(UserPose(stamp_ns=time.time_ns(), seq=count, position_m=(1.0, 1.0, 0.0), yaw_rad=0.0))

        def is_heard() -> bool:
            if not buttons:
                press()  # nobody may hear the first ones
            return bool(buttons)

        await until(is_heard, what="a button")
        for _ in range(3):
            for _ in range(burst):
                press()
            await until(lambda: buttons[-1:] == poses[-1:] == [count], what="the last of a burst")
        assert buttons[-3 * burst :] == list(range(count - 3 * burst + 1, count + 1))
        assert heard.traffic.lost == 0
        await anna.close()
        await services.close()


@pytest.mark.slow
async def test_continual_history_queries_get_few_answers_and_delay_nobody(
    folder: SiteFolder,
) -> None:
    answered: Counter[int] = Counter()

    async def answer(query: ReadHistory, _name: str) -> ReadHistoryReply:
        answered[query.last] += 1
        return ReadHistoryReply(message="none")

    async def ask(bus: ZenohBus) -> None:
        with contextlib.suppress(PointItError):
            await bus.call(READ_HISTORY, ReadHistory(last=1), timeout_s=0.5)

    with RouterProgram("--site-folder", str(folder.path)):
        services, anna, ben = [
            await ZenohBus.open(link_of(folder, name), patience_s=30) for name in ("services", "anna", "ben")
        ]
        services.serve(READ_HISTORY, answer)
        began_s = time.monotonic()
        for _ in range(10):
            await asyncio.gather(*(ask(anna) for _ in range(10)))
            await ben.call(READ_HISTORY, ReadHistory(last=2))
        took_s = time.monotonic() - began_s
        assert answered[2] == 10
        assert 0 < answered[1] <= MAX_HISTORY_HZ * took_s + 2
        for bus in (anna, ben, services):
            await bus.close()


async def test_eight_questions_for_past_events_at_once_are_answered(folder: SiteFolder) -> None:
    async def answer(query: ReadHistory, _name: str) -> ReadHistoryReply:
        return ReadHistoryReply(message=str(query.last))

    with routed(folder):
        services, anna = [
            await ZenohBus.open(link_of(folder, name), patience_s=30) for name in ("services", "anna")
        ]
        services.serve(READ_HISTORY, answer)
        asked = [anna.call(READ_HISTORY, ReadHistory(last=last), timeout_s=30) for last in range(1, 9)]
        assert [reply.message for reply in await asyncio.gather(*asked)] == list("12345678")
        for bus in (anna, services):
            await bus.close()


@pytest.mark.slow
def test_connections_beyond_an_identitys_limit_are_cut_and_named(folder: SiteFolder) -> None:
    more = 8
    with RouterProgram("--site-folder", str(folder.path)) as router, ExitStack() as stack:
        site = [stack.enter_context(Member(folder, "services")) for _ in range(MAX_CONNECTIONS + more)]
        kept = [Ends(each) for each in (*site, stack.enter_context(Member(folder, "ben")))]
        # which of them are the newest the router cannot know of those that arrive between two of its checks
        anna = [Ends(stack.enter_context(Member(folder, "anna"))) for _ in range(MAX_CONNECTIONS + more)]
        wait(lambda: "lab/anna has " in router.said, "the name")
        wait(lambda: sum(each.count > 0 for each in anna) >= more, "the newest to be cut")
        assert [each.count for each in kept] == [0] * len(kept)
        assert "lab/services has" not in router.said


FLOOD_HZ = 2000.0
SETTLE_S = 0.5
"""Time in which what a router has already read goes out."""
CHECKS = 3
"""Number of a router's reports after which it has checked what had been declared before the first."""


@contextmanager
def flooding(folder: SiteFolder, name: str, kind: str) -> Generator[None]:
    """Have a process of its own flood and come back within 1 ms: Zenoh's client may crash of that."""
    program = [sys.executable, "-m", "tests.faults.attackers", str(folder.path), name, str(FLOOD_HZ), kind]
    with subprocess.Popen(program, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            yield
        finally:
            process.kill()


@pytest.mark.slow
@pytest.mark.parametrize("kind", DECLARATIONS)
def test_endless_declarations_and_queries_are_named_and_cut_off(folder: SiteFolder, kind: str) -> None:
    reports: list[Health] = []
    with (
        RouterProgram("--site-folder", str(folder.path)) as router,
        Member(folder, "operator") as operator,
        Member(folder, "services") as services,
        services.serving(READ_HISTORY.at()) as asked,
    ):
        came_s: list[float] = []

        def on_token(_: zenoh.Sample) -> None:
            came_s.append(time.monotonic())

        def on_health(sample: zenoh.Sample) -> None:
            reports.append(decode(Health, sample.payload.to_bytes()))

        tokens = operator.session.liveliness().declare_subscriber(
            USER_ALIVE.at("anna"), Callback(on_token, indirect=False)
        )
        health = operator.session.declare_subscriber(HEALTH.at("router"), Callback(on_health, indirect=False))

        def problems() -> list[str]:
            return [each.code for each in reports[-1].problems] if reports else []

        with flooding(folder, "anna", kind):
            wait(lambda: "lab/anna has written or asked " in router.said, "the reason")
            wait(lambda: EXCESS in problems(), "the reason in health")
            time.sleep(SETTLE_S)
            before = len(came_s), len(asked)
            time.sleep(2.0)
            assert (len(came_s), len(asked)) == before, "what it sends while it is cut off goes nowhere"
        now_s = time.monotonic()
        report = DiagnosisReport(received_s=now_s, health=reports[-1], arrived_ns=time.time_ns())
        seen = Observation(
            began_s=now_s - 5.0, now_s=now_s, present=frozenset({"router"}), reports={"router": [report]}
        )

        assert any("lab/anna has written or asked " in each.sentence for each in diagnose(seen))
        tokens.undeclare()
        health.undeclare()


@pytest.mark.slow
async def test_sixteen_viewers_who_return_at_once_are_not_cut_off(folder: SiteFolder) -> None:
    with RouterProgram("--site-folder", str(folder.path)) as router:
        link = link_of(folder, "dashboard1")
        reports = list[Health]()

        async def is_checked() -> None:
            count = len(reports) + CHECKS
            await until(lambda: len(reports) >= count, what="the router's checks")

        viewers = [await ZenohBus.open(link, patience_s=30) for _ in range(16)]
        for viewer in viewers:
            for topic in viewer_topics():
                viewer.subscribe(topic, lambda _message, _name: None)
            for presence in PRESENCES:
                viewer.watch(presence, lambda _name, **_: None)
        viewers[0].subscribe(HEALTH, lambda health, _name: reports.append(health), "router")
        await is_checked()

        folder.add({"carla": "user"}, now())  # the router opens again, and all connections with it
        await until(lambda: "that there are now" in router.said, what="the new rules")
        await until(lambda: all(viewer.connected for viewer in viewers), what="all to be back")

        await is_checked()
        for viewer in viewers:
            await viewer.close()
        assert "lab/dashboard1 has " not in router.said, "neither of many messages nor of many connections"


class Ends:
    def __init__(self, member: Member) -> None:
        self.count = 0
        self._listener = member.session.info.declare_transport_events_listener(
            Callback(self._on_event, indirect=False), history=False
        )

    def _on_event(self, event: zenoh.TransportEvent) -> None:
        self.count += event.kind == zenoh.SampleKind.DELETE


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere nobody finds the sockets of Zenoh")
async def test_no_connection_that_was_accepted_lingers(tmp_path: Path) -> None:
    folder = make_site(tmp_path / "lab", password=True)
    port = folder.state().port
    router = Router(lambda: json.dumps(configuration([folder.router_site()], ["127.0.0.1"])), Path(), [])

    def lingering() -> list[bool]:
        found: list[bool] = []
        for each in own_sockets():
            with contextlib.suppress(OSError):  # closed meanwhile
                if each.getsockname()[1] == port and not _listens(each):
                    value = each.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.size)
                    found.append(bool(LINGER.unpack(value)[0]))
        return found

    await router.open()
    following = asyncio.create_task(router.reload_on_change(), name="router")
    try:
        with Member(folder, "anna"):
            await until(lambda: lingering() == [False], what="the router to let go")
    finally:
        following.cancel()
        await router.close()


def _listens(found: socket.socket) -> bool:
    return bool(found.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN))
