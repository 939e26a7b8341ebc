"""Attackers of a secured site, and the warnings to its operator.

As a program, `python -m tests.faults.attackers SITE-FOLDER NAME RATE KEYS…` floods keys under an identity.
Instead of a key, one of `DECLARATIONS` may stand. When it is cut off, it connects again within milliseconds.
"""

import asyncio
import contextlib
import itertools
import statistics
import sys
import time
from collections.abc import AsyncGenerator, Callable, Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import zenoh
from zenoh.handlers import Callback, FifoChannel

from pointit.access.site_folder import SiteFolder
from pointit.runtime.link.link import Link
from pointit.runtime.router_health import SERVICE
from pointit.runtime.zenoh.session import configuration
from pointit.schemas import ButtonEvent, Claim, Cursor, Health, Message, encode
from pointit.schemas.topics import (
    BUTTON,
    CLAIM,
    CURSOR,
    HEALTH,
    READ_HISTORY,
    REQUESTS,
    TOPICS,
    USER_ALIVE,
    Topic,
    topic_of,
)
from tests.faults.account import Account, Memory
from tests.faults.site import PEOPLE, Site
from tests.faults.witness import Witness, witness
from tests.integration.access.secured import Member
from tests.support.bench import until
from tests.support.commands import Command
from tests.support.pace import Patience

PATIENCE_S = 20.0
"""The same on a machine that is busy with other things."""
ROUTER = SERVICE
LARGE = 1_500_000
"""More than any message of a site may have, and less than the router puts together."""
MARK = b"attack"
"""Payload of attackers, which is no message of ours."""
SECONDS_OF_A_BURST = 0.01


@dataclass
class Besieged:
    """A site that is attacked, as its operator sees it."""

    site: Site
    seen: Witness
    began_s: float = field(default_factory=time.monotonic)
    began_ns: int = field(default_factory=time.time_ns)
    memory: Memory = field(default_factory=lambda: Memory({}))
    _refused: float = 0.0
    _heard: list[tuple[str, float]] = field(default_factory=list[tuple[str, float]])
    """User and age (s) of each received cursor."""

    _warnings: set[str] = field(default_factory=set[str])
    """Warnings of the router since the attack began: a busy machine shows each too briefly to be seen."""

    def __post_init__(self) -> None:
        self.seen.bus.subscribe(CURSOR, self._on_cursor)
        self.seen.bus.subscribe(HEALTH, self._on_health, ROUTER)
        self.begin()

    def begin(self) -> None:
        """An attack begins now."""
        pids = {pid for instance, (pid, _) in self.seen.processes().items() if instance != "web"}
        self.memory = Memory.now(pids | {self.site.router.process.pid})
        self.began_s, self.began_ns = time.monotonic(), time.time_ns()
        self._refused = self.refused
        self._heard.clear()
        self._warnings.clear()

    @property
    def refused(self) -> float:
        """Return the number of attempts that the router has refused so far, as doctor shows it."""
        health = self.seen.health.get(ROUTER)
        return (
            next((figure.value for figure in health.figures if figure.name == "refused"), 0.0)
            if health
            else 0.0
        )

    @property
    def refused_since(self) -> float:
        return self.refused - self._refused

    def shown(self, instance: str = ROUTER) -> str:
        return "\n".join(finding.sentence for finding in self.seen.findings(instance))

    async def is_told(
        self, *words: str, instance: str = ROUTER, again: Callable[[], object] = bool, refused: bool = True
    ) -> float:
        """Wait until doctor and the router's log have shown each of `words`. Return the time it took, s.

        They need not be shown together: the router reports once a second the news of each identity. The
        attack may be repeated by `again` until then, and was `refused`.
        """
        missing = list(words)

        def is_shown() -> bool:
            shown = "\n".join([self.shown(instance), *(self._warnings if instance == ROUTER else ())])
            missing[:] = [each for each in missing if each not in shown]
            return not missing and (instance != ROUTER or not refused or self.refused_since > 0)

        patience = Patience(PATIENCE_S)
        while not is_shown():
            await asyncio.to_thread(again)  # the loop, which receives and times all, goes on meanwhile
            await asyncio.sleep(0.05)
            assert not patience.is_over(), f"{missing} are not shown, but {self.shown(instance)!r}"
        noticed_s = time.monotonic() - self.began_s
        if instance == ROUTER:
            for each in words:
                await self.site.router.says(each)
        return noticed_s

    def _on_health(self, health: Health, _instance: str) -> None:
        self._warnings.update(health.warnings)

    async def unharmed(self) -> None:
        await self.seen.flows()
        await self.seen.agrees(self.site)

    def delay_s(self, user: str = PEOPLE[1]) -> float:
        """Return the age of the cursors of an innocent person, median since the attack began, s."""
        delays = [delay_s for who, delay_s in self._heard if who == user]
        return statistics.median(delays) if delays else float("inf")

    def longest_silence_s(self) -> float:
        """Return the longest time without a cursor of any person since the attack began, s."""
        came_ns = [came_ns for _, _, came_ns in self.seen.arrivals if came_ns >= self.began_ns]
        return max(after - before for before, after in itertools.pairwise([self.began_ns, *came_ns])) / 1e9

    def growth_mb(self) -> float:
        return Memory.now(self.memory.of).growth_mb(self.memory)

    def row(self, account: Account, name: str, noticed_s: float | None, by: str, lost: str = "") -> None:
        by_password = self.site.folder.state().password
        account.add(
            f"{name} (site by passwords)" if by_password else name,
            noticed_s,
            by,
            None,
            lost or self.seen.lost_in_words(self.began_ns),
            memory_mb=self.growth_mb(),
        )

    def _on_cursor(self, cursor: Cursor, user: str) -> None:
        self._heard.append((user, (time.time_ns() - cursor.stamp_ns) / 1e9))


@contextlib.asynccontextmanager
async def besieged(site: Site) -> AsyncGenerator[Besieged]:
    async with witness(site) as seen:
        await seen.begins(site)
        await seen.hears(ROUTER)
        yield Besieged(site, seen)


@contextlib.asynccontextmanager
async def new_rules(site: Site) -> AsyncGenerator[None]:
    """Wait at the end until the router applies the rules changed inside."""
    count = site.router.err.count("that there are now")
    yield
    try:
        await until(lambda: site.router.err.count("that there are now") > count, 10, "the router's new rules")
    except AssertionError as error:
        raise AssertionError(f"{error}; the router said last: {site.router.err[-2000:]}") from error


@contextlib.contextmanager
def member(site: Site, name: str) -> Generator[Member]:
    with Member(site.folder, name) as somebody:
        yield somebody


def attack(evil: Member, keys: Sequence[str], payload: bytes = MARK) -> None:
    for key in keys:
        evil.session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)


@contextlib.contextmanager
def overhearing(who: Member, *keys: str) -> Generator[list[str]]:
    """Yield a list that grows by the keys under which the mark of an attack arrives."""
    heard: list[str] = []

    def hear(sample: zenoh.Sample) -> None:
        if sample.payload.to_bytes() == MARK:
            heard.append(str(sample.key_expr))

    subscribers = [who.session.declare_subscriber(key, Callback(hear, indirect=False)) for key in keys]
    yield heard
    for subscriber in subscribers:
        subscriber.undeclare()


def name_of(row: object, user: str) -> str:
    placeholder = getattr(row, "placeholder", "")
    return {"": "", "user": user, "service": f"pointing.{user}"}.get(placeholder, "thing")


def keys_of(user: str) -> tuple[str, ...]:
    """Return every key of the topic table, those of a person for `user`."""
    return tuple(topic.at(name_of(topic, user)) for topic in TOPICS)


def request_keys_of(user: str) -> tuple[str, ...]:
    return tuple(request.at(name_of(request, user)) for request in REQUESTS)


@contextlib.contextmanager
def flooding(site: Site, name: str, rate_hz: float, *keys: str) -> Generator[Command]:
    """Run a process that writes each of `keys` in turn, `rate_hz` in all, while inside."""
    program = [sys.executable, "-m", "tests.faults.attackers"]
    command = site.commands.run([*program, str(site.folder.path), name, str(rate_hz), *keys])
    try:
        yield command
    finally:
        command.kill()


def flood(folder: SiteFolder, name: str, rate_hz: float, keys: Sequence[str]) -> None:
    """Write until killed; say once a second how often."""
    with Member(folder, name, retry_ms=1) as somebody:
        acts = [_act(somebody.session, name, key) for key in keys]
        began_s = time.monotonic()
        sys.stdout.write("begins\n")
        sys.stdout.flush()
        for count, act in enumerate(itertools.cycle(acts), 1):
            with contextlib.suppress(zenoh.ZError):  # it is cut off
                act()
            ahead_s = count / rate_hz - (time.monotonic() - began_s)
            if ahead_s > SECONDS_OF_A_BURST:
                time.sleep(ahead_s)
            if count % max(1, round(rate_hz)) == 0:
                sys.stdout.write(f"{count} in {time.monotonic() - began_s:.1f} s\n")
                sys.stdout.flush()


DECLARATIONS = ("presence", "subscriptions", "questions")


def _act(session: zenoh.Session, name: str, key: str) -> Callable[[], object]:
    """Return a function that declares and takes back, asks, or writes once."""
    if key == "presence":
        return lambda: session.liveliness().declare_token(USER_ALIVE.at(name)).undeclare()
    if key == "subscriptions":
        return lambda: session.declare_subscriber(CURSOR.at(name), lambda _: None).undeclare()
    if key == "questions":
        return lambda: session.get(READ_HISTORY.at(), FifoChannel(1), timeout=0.1)
    payload = _payload(key)
    return lambda: session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)


def _payload(key: str) -> bytes:
    """Return a message that equals that of a person where such messages are handled, else no message."""
    now_ns = time.time_ns()
    messages: dict[Topic[Any], Message] = {
        BUTTON: ButtonEvent(stamp_ns=now_ns),
        CLAIM: Claim(stamp_ns=now_ns, object_id="nothing", wish="toggle"),
        CURSOR: Cursor(stamp_ns=now_ns, surface="strip", surface_id="0", point_m=(1.0, 0.0, 0.9)),
    }
    topic = topic_of(key)
    return encode(messages[topic]) if topic in messages else bytes(100)


if __name__ == "__main__":
    flood(SiteFolder(Path(sys.argv[1])), sys.argv[2], float(sys.argv[3]), sys.argv[4:])


KNOCK_MS = 300
"""Duration of one attempt that the router reports. Accepted ones succeed within 10 ms."""
SHUT_MS = 2000
"""Duration of an attempt whose rejection shows only by its failure."""


def is_not_let_in(config: zenoh.Config, for_ms: int = KNOCK_MS) -> None:
    """Try to connect with `config`, whose patience is changed. Fail if that succeeds.

    It also fails on a machine that is too slow, so check the router's report too, or use `keeps_out`.
    """
    config.insert_json5("connect/timeout_ms", str(for_ms))
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)


def keeps_out(who: Link, rightful: Link) -> None:
    """Fail if `who` can connect, or if the `rightful` cannot in the same time."""
    patience = Patience(PATIENCE_S)
    for_ms = SHUT_MS
    while True:
        config = configuration(rightful)
        config.insert_json5("connect/timeout_ms", str(for_ms))
        try:
            zenoh.open(config).close()
            break
        except zenoh.ZError:  # a busy machine
            if patience.is_over():
                raise
            for_ms *= 2
    is_not_let_in(configuration(who), for_ms)
