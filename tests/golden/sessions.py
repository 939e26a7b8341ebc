"""Golden sessions: what they are, how one is played, and how its messages are hashed.

`python -m tests.golden.sessions` rewrites hashes.json; with `--dump FOLDER` it writes the messages instead.
"""

import argparse
import asyncio
import contextlib
import csv
import hashlib
import json
import math
import os
import random
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar
from unittest import mock

from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.scenario import read_scenario
from pointit.runtime.bus.contract import Subscription
from pointit.runtime.bus.local_broker import LocalBroker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import BusClosedError
from pointit.runtime.service.service import Launch, run_services
from pointit.schemas import Message
from pointit.schemas.topics import ANY, HEALTH, TOPICS, Delivery, Topic
from tests.integration.scenario.virtual_time import START_NS, VirtualClock, run_virtually

M = TypeVar("M", bound=Message)

HASHES = Path(__file__).with_name("hashes.json")

HASHED: tuple[Topic[Any], ...] = tuple(topic for topic in TOPICS if topic is not HEALTH)
"""Health reports the load and delays of this machine: wall time."""

DECIMALS = 6
"""Numbers are hashed after rounding to so many: micrometres, microradians, shares of a million."""

ROBOT = "robot.csv"


@dataclass(frozen=True, kw_only=True)
class Session:
    """One or several people in a shipped scenario, for some seconds of virtual time."""

    scenario: str
    duration_s: float
    happens: tuple[str, ...]
    """Keys on which something must have been said, and `key=value`: with that event, state, cue or method."""
    choices: Choices = field(default_factory=lambda: Choices(seed=1))
    users: tuple[str, ...] = ("anna",)
    site: Mapping[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    """Further services for all."""
    restarts: bool = False
    """Every service but the simulated person is restarted once, one after the other."""
    link: Callable[[LocalBroker], MemoryBus] = MemoryBus


class BadLink(MemoryBus):
    """A bus on which every reader loses a tenth of the messages of *latest* topics and gets the others late.

    Events and states, which are delivered reliably, are late and in order.
    """

    LOST = 0.1
    LATE_S = 0.1
    JITTER_S = 0.05

    def __init__(self, exchange: LocalBroker) -> None:
        super().__init__(exchange)
        self._random = random.Random(1)

    def subscribe(
        self, topic: Topic[M], handler: Callable[[M, str], None], name: str = ANY, *, kept: bool = True
    ) -> Subscription:
        loop = asyncio.get_running_loop()

        def deliver(message: M, its_name: str) -> None:
            with contextlib.suppress(BusClosedError):  # the reader may have ended meanwhile
                handler(message, its_name)

        def on_arrival(message: M, its_name: str) -> None:
            late_s = self.LATE_S
            if topic.delivery is Delivery.LATEST:
                if self._random.random() < self.LOST:
                    return
                late_s += self._random.uniform(-self.JITTER_S, self.JITTER_S)
            loop.call_later(late_s, deliver, message, its_name)

        return super().subscribe(topic, on_arrival, name, kept=kept)


def _choices(*settings: str, localize: bool = False, **chosen: Any) -> Choices:
    return Choices(seed=1, localize=localize, settings=settings, **chosen)


SESSIONS: dict[str, Session] = {
    "scenario 1": Session(
        scenario="scenario_1", duration_s=15.0, happens=("leds/led_1/color", "users/anna/cursor=lamp")
    ),
    "scenario 2": Session(scenario="scenario_2", duration_s=15.0, happens=("users/anna/cursor=strip",)),
    "scenario 3, by fraction": Session(
        scenario="scenario_3", duration_s=30.0, happens=("selection/events=selected",)
    ),
    "scenario 4, by gauge": Session(
        scenario="scenario_4",
        duration_s=40.0,
        happens=("selection/events=selected", "selection/events=dispatched"),
    ),
    "scenario 3, by hold": Session(
        scenario="scenario_3",
        duration_s=20.0,
        choices=_choices(method="hold"),
        happens=("selection/events=selected",),
    ),
    "send_a_robot": Session(scenario="send_a_robot", duration_s=30.0, happens=("users/anna/goal",)),
    "localized by lamps": Session(
        scenario="scenario_2",
        duration_s=60.0,
        choices=_choices(
            "user-sim.aim.elevation_bias_deg=10", "user-sim.wristband.yaw_drift_degpmin=40", localize=True
        ),
        happens=("users/anna/pose=static_targets", "users/anna/anchor", "users/anna/cursor=strip"),
    ),
    "localized by a robot": Session(
        scenario="scenario_2",
        duration_s=30.0,
        choices=_choices("localizer.method=moving_target", localize=True),
        site={"robot-replay": {"recording": ROBOT}},
        happens=("users/anna/pose=moving_target", "users/anna/cursor=strip"),
    ),
    "two people": Session(
        scenario="scenario_3",
        duration_s=45.0,
        choices=_choices(localize=True),
        users=("anna", "ben"),
        happens=(
            "users/anna/pose=static_targets",
            "users/ben/pose=static_targets",
            "selection/events=selected",
        ),
    ),
    "four people": Session(
        scenario="scenario_4",
        duration_s=20.0,
        users=("anna", "ben", "carl", "dora"),
        happens=("selection/events=selected", "users/dora/hover"),
    ),
    "a restart of each service": Session(
        scenario="scenario_3", duration_s=30.0, restarts=True, happens=("selection/events=selected",)
    ),
    "a bad link": Session(
        scenario="scenario_3", duration_s=30.0, link=BadLink, happens=("selection/events=selected",)
    ),
}


class Record:
    """The messages of a session by key, in the order of the topic table."""

    def __init__(self, bus: MemoryBus) -> None:
        """Read everything on `bus` but health, as events: of those no message replaces the one before."""
        self._messages: dict[str, dict[str, list[Message]]] = {topic.key: {} for topic in HASHED}
        for topic in HASHED:
            bus.subscribe(replace(topic, delivery=Delivery.EVENT), self._reader(topic))

    def _reader(self, topic: Topic[Any]) -> Callable[[Message, str], None]:
        messages = self._messages[topic.key]
        return lambda message, name: messages.setdefault(name, []).append(message)

    def messages(self) -> Iterator[tuple[str, list[Message]]]:
        """Yield each key on which something was said, with its messages."""
        for topic in HASHED:
            for name in sorted(self._messages[topic.key]):
                yield topic.at(name), self._messages[topic.key][name]

    def hashes(self) -> dict[str, str]:
        """Return `count hash` by key."""
        found: dict[str, str] = {}
        for key, messages in self.messages():
            digest = hashlib.sha256()
            for message in messages:
                digest.update(canonical(message).encode() + b"\n")
            found[key] = f"{len(messages)} {digest.hexdigest()[:16]}"
        return found

    def has(self, what: str) -> bool:
        """Return whether something was said on the key `what`, or on the key of `key=value` with that value."""
        key, _, value = what.partition("=")
        return any(
            not value or value in vars(message).values()
            for its_key, messages in self.messages()
            if its_key == key
            for message in messages
        )


def canonical(message: Message) -> str:
    """Return one line with the message's name, version and fields, the same wherever it is computed."""
    return f"{message.schema_name()} {json.dumps(_rounded(message.model_dump()), sort_keys=True)}"


def _rounded(value: Any) -> Any:
    match value:
        case float():
            return round(value, DECIMALS) + 0.0  # never -0.0
        case dict():
            return {key: _rounded(item) for key, item in value.items()}
        case list() | tuple():
            return [_rounded(item) for item in value]
        case bytes():
            return value.hex()
        case _:
            return value


def play(session: Session) -> Record:
    """Play `session` in virtual time, on nothing kept before and whatever the environment says."""
    others = {name: value for name, value in os.environ.items() if not name.startswith("POINTIT_")}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        _write_robot(Path(ROBOT))
        with mock.patch.dict(os.environ, others | {"POINTIT_STATE": folder}, clear=True):
            return run_virtually(_play(session))


def _write_robot(path: Path) -> None:
    """Write the recording of a robot that drives a figure of eight about the place where people stand."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["t", "qw", "qx", "qy", "qz", "robot_x", "robot_y", "robot_z"])
        for tick in range(25 * 60):
            angle = 0.4 * tick / 25
            x, y = 2.0 + 2.5 * math.cos(angle), 0.5 + 1.5 * math.sin(2 * angle)
            rows.writerow([f"{number:.4f}" for number in (tick / 25, 1, 0, 0, 0, x, y, 0.1)])


async def _play(session: Session) -> Record:
    plan = read_scenario(session.scenario)
    plan = plan.model_copy(update={"site": {**plan.site, **session.site}})
    launches = site_launches(plan, session.choices)
    for index, user in enumerate(session.users):
        launches += user_launches(plan, session.choices, user, index)
    exchange = LocalBroker()
    onlooker, bus = MemoryBus(exchange), session.link(exchange)
    record = Record(onlooker)
    lives = [asyncio.create_task(_live(launch, bus)) for launch in launches]
    if session.restarts:
        await _restart_each(launches, lives, bus, session.duration_s)
    await asyncio.wait(lives, timeout=session.duration_s - (VirtualClock().now_ns() - START_NS) / 1e9)
    for life in lives:
        life.cancel()
    for result in await asyncio.gather(*lives, return_exceptions=True):
        if not isinstance(result, asyncio.CancelledError):
            raise AssertionError("a service ended by itself") from result
    await asyncio.sleep(1.0)
    await bus.close()
    await onlooker.close()
    return record


async def _live(launch: Launch, bus: MemoryBus) -> None:
    await run_services([launch], bus, VirtualClock())


async def _restart_each(
    launches: Sequence[Launch], lives: list[asyncio.Task[None]], bus: MemoryBus, duration_s: float
) -> None:
    pause_s = 0.6 * duration_s / len(launches)
    await asyncio.sleep(0.2 * duration_s)
    for index, launch in enumerate(launches):
        if launch.service.NAME == "user-sim":
            continue
        lives[index].cancel()
        await asyncio.gather(lives[index], return_exceptions=True)
        await asyncio.sleep(0.2)
        lives[index] = asyncio.create_task(_live(launch, bus))
        await asyncio.sleep(pause_s - 0.2)


def main() -> None:
    """Rewrite the hashes, or dump messages."""
    parser = argparse.ArgumentParser(prog="python -m tests.golden.sessions", description=__doc__)
    parser.add_argument("sessions", nargs="*", help="all unless named: " + "; ".join(SESSIONS))
    parser.add_argument("--dump", type=Path, metavar="FOLDER", help="one file of lines for each key")
    chosen = parser.parse_args()
    known: dict[str, dict[str, str]] = json.loads(HASHES.read_text()) if HASHES.exists() else {}
    for name in chosen.sessions or SESSIONS:
        began_s = time.process_time()
        record = play(SESSIONS[name])
        if chosen.dump:
            for key, messages in record.messages():
                path = chosen.dump / name / f"{key.replace('/', '.')}.jsonl"
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text("".join(f"{canonical(message)}\n" for message in messages), encoding="utf-8")
        else:
            known[name] = record.hashes()
        lacks = [what for what in SESSIONS[name].happens if not record.has(what)]
        print(f"{name}: {time.process_time() - began_s:.1f} s of CPU, lacks {lacks}")  # noqa: T201
    if not chosen.dump:
        kept = {name: known[name] for name in SESSIONS if name in known}
        HASHES.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
