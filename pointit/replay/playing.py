"""Plays a recording: replayed services on a bus beside other messages at their recorded times."""

import asyncio
import contextlib
import json
import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, cast

from pointit.recording.entries import AnyRow, Entry, entry_of
from pointit.replay.edge import RecordedRequests, RecordedResults, ReplayEdge
from pointit.replay.replayed_services import (
    GATHERING_NS,
    OBSERVERS,
    Beginning,
    Level,
    RecordingClock,
    ReplayedServices,
    ReplayError,
    Split,
    is_about_site,
    parameters_of,
    read_beginning,
    scratch_folder,
)
from pointit.runtime.bus.contract import AnyTopic, Bus, Closable, Subscription, list_present
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.bus.site_clock import publish_time
from pointit.runtime.clock import Clock
from pointit.runtime.errors import RequestError, first_cause
from pointit.runtime.host.state_file import using_state_directory
from pointit.runtime.service.instance_takeover import LISTEN_S
from pointit.runtime.virtual_time import run_virtually
from pointit.schemas import (
    NS_PER_S,
    Configuration,
    Health,
    Message,
    ServedRequest,
)
from pointit.schemas.system import split_instance
from pointit.schemas.table_types import PresenceHandler
from pointit.schemas.topics import (
    ACT_RESULTS,
    BEGIN_ACT,
    CONFIGURATION,
    HEALTH,
    PRESENCES,
    SERVED,
    SERVICE_ALIVE,
    SET_POSE,
    THING_STATES,
    TOPICS,
    Delivery,
    Presence,
    Request,
    Topic,
    topic_of,
)

log = logging.getLogger(__name__)

SETTLE_NS = NS_PER_S // 1000
"""Time after the last entry in which the services answer it, ns."""

MAX_GAP_NS = 600 * NS_PER_S
"""Longest time without entries that is replayed, ns. After a longer one the site's clock has jumped."""

STARTING_NS = NS_PER_S // 20
"""Time after a beginning in mid-session in which services put the states and cues with which they start, ns.
These are not compared: the recorded ones are older."""

LIVE_STARTING_S = 3.0
"""The same on a site from any beginning, s: services take their time to start there."""


class Collector:
    """Hands all messages, answered requests and changes of presence on a bus to a function, each of them."""

    def __init__(self, bus: Bus, clock: Clock, take: Callable[[Entry], None]) -> None:
        self._clock = clock
        self._take = take
        self._declared: list[Subscription] = []
        for topic in TOPICS:
            if topic is not SERVED:
                self._declared.append(bus.subscribe(topic, self._reader(topic), queue_all=True))
        self._declared.append(bus.subscribe(SERVED, self._on_served))
        self._watched: list[Closable] = []
        for presence in PRESENCES:
            self._watched.append(bus.watch(presence, self._watcher(presence)))

    @property
    def dropped(self) -> int:
        """Number of messages that came faster than they were taken, and are missing."""
        return sum(declared.traffic.dropped for declared in self._declared)

    def close(self) -> None:
        """Stop collecting."""
        for declared in (*self._declared, *self._watched):
            declared.close()

    def _reader(self, topic: AnyTopic) -> Callable[[Any, str], None]:
        def on_message(message: Message, name: str) -> None:
            now_ns = self._clock.now_ns()
            self._take(Entry(now_ns, topic.at(name), topic, name, message))

        return on_message

    def _on_served(self, served: ServedRequest, instance: str) -> None:
        exchange = entry_of(served, instance, self._clock.now_ns())
        if exchange is not None:
            self._take(exchange)

    def _watcher(self, presence: Presence) -> PresenceHandler:
        def on_change(name: str, *, present: bool) -> None:
            now_ns = self._clock.now_ns()
            self._take(Entry(now_ns, presence.at(name), presence, name, present))

        return on_change


class Skipped:
    """Numbers of messages that services did not get, or skipped for newer ones, by their health reports."""

    def __init__(self) -> None:
        self._counts: dict[tuple[str, str], int] = {}
        """By instance and key."""

    def add(self, instance: str, health: Health) -> None:
        """Add a report. Its numbers count from the start of the service."""
        for key in health.keys:
            if key.direction == "in":
                self._counts[instance, key.key] = key.dropped + key.lost

    def log(self) -> None:
        """Log a warning if there are any."""
        total = sum(self._counts.values())
        if not total:
            return
        keys: set[str] = set()
        for (_instance, key), count in self._counts.items():
            if count:
                keys.add(key)
        log.warning(
            "services skipped %d messages (%s), as this machine is too slow: replay at a lower --speed, "
            "or without --live",
            total,
            ", ".join(sorted(keys)),
        )


class ReplayRecording(Protocol):
    """A recording that can be read several times, such as `pointit.recording.reader.Recording`."""

    @property
    def began_ns(self) -> int:
        """Return the time of its beginning, Unix ns."""
        ...

    @property
    def ended_ns(self) -> int:
        """Return the time of its last entry, Unix ns."""
        ...

    def gap(self, longer_ns: int) -> tuple[int, int] | None:
        """Return start and end of the first time without entries of more than `longer_ns`, Unix ns."""
        ...

    def entries(self, keys: Callable[[str], bool] | None = None) -> Iterator[Entry]:
        """Yield its entries in order of time, those of certain `keys` only if given."""
        ...


class ReplayListener(Protocol):
    """Takes what a replay yields."""

    def recorded(self, entry: Entry) -> None:
        """Add an entry of the recording that the replay recomputes."""
        ...

    def replayed(self, entry: Entry, *, is_recomputed: bool) -> None:
        """Add an entry of the result: computed now, or repeated from the recording."""
        ...


@dataclass(frozen=True)
class Buses:
    """Participants of one exchange."""

    services: Bus
    edge: Bus
    observer: Bus


@dataclass(frozen=True)
class ReplayPlan:
    """A recording and the part of it that is recomputed."""

    source: ReplayRecording
    beginning: Beginning
    split: Split
    live: bool = False
    """True if a site takes part, which has a page, a recorder and so on of its own."""
    lights: bool = False
    """True if led-driver drives the strips of its recorded parameters."""


def plan_replay(source: ReplayRecording, level: Level) -> ReplayPlan:
    """Return the plan of a replay of `source`.

    Raises:
        ReplayError: None of the services of `level` is in it, or its time jumps.
    """
    gap = source.gap(MAX_GAP_NS)
    if gap is not None:
        begin_ns, end_ns = gap
        after_s = (begin_ns - source.began_ns) / NS_PER_S
        length_s = (end_ns - begin_ns) / NS_PER_S
        place = f"{length_s:.0f} s from {after_s:.1f} s after its beginning"
        raise ReplayError(
            f"the recording has nothing for {place}: the "
            "clock of its site jumped or its machine slept, and it cannot be replayed: record it again"
        )
    beginning = read_beginning(source.entries(_is_state), source.began_ns)
    return ReplayPlan(source, beginning, Split(level, beginning.instances))


def replay(plan: ReplayPlan, listener: ReplayListener) -> None:
    """Play `plan` in virtual time, on a bus in memory. The same recording gives the same entries.

    Raises:
        ReplayError: The services in it cannot be replayed.
    """
    run_virtually(replay_by_loop_time(plan, listener, 1.0))


async def replay_by_loop_time(plan: ReplayPlan, listener: ReplayListener, speed: float) -> None:
    """Play `plan` on a bus in memory, `speed` times as fast as it was recorded, by the loop's time.

    Raises:
        ReplayError: The services in it cannot be replayed.
    """
    broker = LocalBroker()
    buses = Buses(MemoryBus(broker), MemoryBus(broker), MemoryBus(broker))
    async with scratch_folder() as folder:
        try:
            clock = RecordingClock(plan.source.began_ns, speed)
            await play(plan, buses, clock, folder, listener)
        finally:
            for bus in (buses.services, buses.edge, buses.observer):
                await bus.close()


def _is_stream(entry: Entry) -> bool:
    row = entry.row
    return isinstance(row, Topic) and row.delivery is Delivery.LATEST


def _is_state(key: str) -> bool:
    topic = topic_of(key)
    return topic is not None and topic.delivery is Delivery.STATE


async def play(
    plan: ReplayPlan, buses: Buses, clock: RecordingClock, folder: Path, listener: ReplayListener
) -> None:
    """Play a recording from its beginning to its end; services store in `folder`, which is empty."""
    try:
        with using_state_directory(folder / "state"):
            async with asyncio.TaskGroup() as group:
                await _Player(plan, buses, clock, listener).play(folder, group)
    except ExceptionGroup as errors:
        raise first_cause(errors) from errors


class _Player:
    def __init__(
        self, plan: ReplayPlan, buses: Buses, clock: RecordingClock, listener: ReplayListener
    ) -> None:
        self._source = plan.source
        self._beginning = plan.beginning
        self._split = plan.split
        self._live = plan.live
        self._lights = plan.lights
        self._buses = buses
        self._clock = clock
        self._listener = listener
        self._edge = ReplayEdge(buses.edge)
        starting_ns = LIVE_STARTING_S * clock.speed * NS_PER_S if plan.live else STARTING_NS
        self._started_ns = plan.source.began_ns + starting_ns
        self._skipped = Skipped()
        self._failure: Exception | None = None
        """First error of the listener, which a bus would log and forget."""

    async def play(self, folder: Path, group: asyncio.TaskGroup) -> None:
        # State that services read when they start, and the edge
        room = self._beginning.restore(self._buses.services.site, folder)
        changed: dict[str, dict[str, object]] = {}
        if not self._lights:
            changed["led-driver"] = {"outputs": []}
        if room is not None:
            changed["pui"] = {"map": str(room)}
        service_bus = ReplayedServices(self._buses.services, self._clock, group, changed)
        self._requests = RecordedRequests(self._buses.edge, self._clock, group)
        self._results = RecordedResults(self._edge, self._requests.repeat)
        collector = Collector(self._buses.observer, self._clock, self._on_result)
        await self._put_retained(service_bus)

        await self._play_entries(service_bus)

        # The end of the services themselves is not collected
        await self._wait_until(self._source.ended_ns + SETTLE_NS)
        collector.close()
        await service_bus.end_all()
        if self._live:
            self._skipped.log()
        if collector.dropped:
            raise ReplayError(
                f"{collector.dropped} messages of the result are missing, as this machine is too slow: "
                "replay at a lower --speed, or without"
            )

    async def _play_entries(self, service_bus: ReplayedServices) -> None:
        """Play each entry at its time, but retained ones, which are there already.

        Results come last in their instant: the question whether an act may begin is recorded with its answer.
        """
        results: list[Entry] = []
        for entry in self._source.entries():
            if results and entry.time_ns > results[0].time_ns:
                self._repeat_results(results)
            is_retained = self._beginning.retained.get(entry.key) == entry
            if is_retained or self._is_left_out(entry.row, entry.name):
                continue
            await self._wait_until(entry.time_ns)
            if self._split.is_recomputed(entry):
                await self._follow(entry, service_bus)
            elif isinstance(entry.row, Request):
                self._listener.replayed(entry, is_recomputed=False)
            elif entry.row in (ACT_RESULTS, THING_STATES):
                results.append(entry)
            else:
                self._edge.repeat(entry)
        self._repeat_results(results)

    def _repeat_results(self, results: list[Entry]) -> None:
        for result in results:
            self._results.repeat(result)
        results.clear()

    def _is_left_out(self, row: AnyRow, name: str) -> bool:
        return self._live and is_about_site(row, name)

    async def _wait_until(self, time_ns: int) -> None:
        await self._clock.wait_until(time_ns)
        if self._failure is not None:
            raise self._failure

    async def _put_retained(self, service_bus: ReplayedServices) -> None:
        # The edge, and the values of services, which these get until all have started
        for topic, name, message in self._beginning.states(self._split, recomputed=False):
            if not self._is_left_out(topic, name):
                self._edge.put(topic, name, message)
        retained = list(self._beginning.states(self._split, recomputed=True))
        topics = list({topic.key: topic for topic, _, _ in retained}.values())

        def values_of(wanted: AnyTopic) -> list[tuple[str, Message]]:
            return [(name, message) for topic, name, message in retained if topic is wanted]

        answers = self._buses.edge.serve_retained(topics, values_of)
        gathering_s = GATHERING_NS / NS_PER_S / self._clock.speed
        asyncio.get_running_loop().call_later(gathering_s, answers.close)

        await self._start_services(service_bus)

    async def _start_services(self, service_bus: ReplayedServices) -> None:
        """Start the services of the beginning, in the order of a site, and give localizers their poses."""
        configurations: list[Entry] = []
        for entry in self._beginning.retained.values():
            if entry.row is CONFIGURATION:
                configurations.append(entry)
        for entry in sorted(configurations, key=lambda entry: self._split.rank(entry.name)):
            service, user = split_instance(entry.name)
            if service == "supervisor":  # it goes on from its interaction
                self._beginning.restore_interaction(user, self._clock.now_ns())
            if self._split.is_recomputed(entry):
                await self._configure(entry, service_bus)
        for user, pose in self._beginning.measured_poses():
            if self._split.runs("localizer", user):
                with contextlib.suppress(RequestError):  # the supervisor sets it a second later
                    await self._buses.edge.call(SET_POSE, pose, user)

    async def _configure(self, entry: Entry, service_bus: ReplayedServices) -> None:
        """Start the service of `entry` if that is a configuration; it stands in the result as it was."""
        if entry.row is CONFIGURATION and isinstance(entry.body, Configuration):
            body = entry.body
            service, owner = split_instance(entry.name)
            is_named = (body.service, body.instance) == (service, entry.name)
            if not is_named or body.user not in ("", owner):
                raise ReplayError(f"{entry.key} names another service: the file was changed, record it again")
            self._listener.replayed(entry, is_recomputed=False)
            await service_bus.start(entry.body)

    async def _follow(self, entry: Entry, service_bus: ReplayedServices) -> None:
        """Do what `entry` says about a replayed service: it began, ended, was asked or wrote something."""
        if entry.row is CONFIGURATION:
            await self._configure(entry, service_bus)
        elif entry.row is SERVICE_ALIVE:
            if entry.body is False:
                await service_bus.end(entry.name)
        elif entry.row is not HEALTH:
            if not (self._live and self._is_start(entry)):
                self._listener.recorded(entry)
            self._results.on_recorded(entry)
            if entry.row is BEGIN_ACT:
                self._repeat_question(entry)
            else:
                self._requests.repeat(entry)

    def _repeat_question(self, entry: Entry) -> None:
        """Ask whether an act may begin, for a carrier that is not replayed: one that is asks by itself."""
        if not self._split.runs(entry.name, ""):
            self._results.repeat(entry)

    def _is_start(self, entry: Entry) -> bool:
        """Return True if `entry` may be a state or cue with which a service starts."""
        return entry.time_ns < self._started_ns and not _is_stream(entry)

    def _on_result(self, entry: Entry) -> None:
        try:
            self._hand_on(entry)
        except Exception as error:  # noqa: BLE001 - raised where the recording is played
            self._failure = self._failure or error

    def _hand_on(self, entry: Entry) -> None:
        is_recomputed = self._split.is_recomputed(entry)
        if is_recomputed and isinstance(entry.body, Health):
            self._skipped.add(entry.name, entry.body)
        if is_recomputed and entry.row in (CONFIGURATION, HEALTH):
            return  # the recorded one stands for it; and wall times differ in every replay
        if isinstance(entry.row, Request):
            self._requests.on_answered(entry)
        if is_recomputed:
            self._results.on_replayed(entry)
        can_be_start = self._live or bool(self._beginning.retained)
        is_start = can_be_start and self._is_start(entry)
        is_compared = is_recomputed and not is_start
        if isinstance(entry.row, Presence):
            is_compared = False
        self._listener.replayed(entry, is_recomputed=is_compared)


def recorded_outputs(source: ReplayRecording) -> list[str]:
    """Return the outputs that led-driver has in `source`, now or later, each as JSON."""
    outputs_as_json: dict[str, None] = {}
    for entry in source.entries(lambda key: key == CONFIGURATION.at("led-driver")):
        if isinstance(entry.body, Configuration):
            with contextlib.suppress(ValueError):  # the replay reports it
                outputs: object = parameters_of(entry.body).get("outputs")
                if isinstance(outputs, list):
                    for output in cast("list[object]", outputs):
                        outputs_as_json[json.dumps(output)] = None
    return list(outputs_as_json)


async def play_live(
    plan: ReplayPlan, bus: Bus, listener: ReplayListener, speed: float, *, lights: bool = False
) -> None:
    """Play a recording on the site of `bus`, and publish its time there.

    Raises:
        ReplayError: Services of the recording run on the site already, or cannot be replayed.
    """
    # The site has its own observers, but one service of a name only
    present = await list_present(bus, SERVICE_ALIVE, LISTEN_S)
    observers: set[str] = set()
    for instance in present:
        service, _ = split_instance(instance)
        if service in OBSERVERS:
            observers.add(instance)
    running_twice = sorted((present - observers) & plan.beginning.instances)
    if running_twice:
        services = ", ".join(running_twice)
        raise ReplayError(
            f"site {bus.site} runs {services}, as the recording does: end them, or name another site"
        )
    # The time is published for as long as it plays: others follow it
    clock = RecordingClock(plan.source.began_ns, speed)
    async with scratch_folder() as folder:
        time = asyncio.create_task(publish_time(clock, bus), name="time of the replay")
        try:
            live_plan = replace(plan, live=True, lights=lights)
            await play(live_plan, Buses(bus, bus, bus), clock, folder, listener)
        finally:
            time.cancel()
            await asyncio.gather(time, return_exceptions=True)
