"""Plays a recording: replayed services on a bus beside other messages at their recorded times."""

import asyncio
import contextlib
import functools
import json
import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, cast

from pointit.recording.entries import AnyRow, Entry, Exchange, entry_of
from pointit.replay.replayed_services import (
    CALLED_BY_SERVICES,
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
from pointit.runtime.bus.contract import AnyTopic, Bus, Closable, list_present
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.bus.site_clock import publish_time
from pointit.runtime.clock import Clock
from pointit.runtime.errors import RequestError, first_cause
from pointit.runtime.host.state_file import using_state_directory
from pointit.runtime.service.instance_takeover import LISTEN_S
from pointit.runtime.virtual_time import run_virtually
from pointit.schemas import (
    NS_PER_S,
    ActResult,
    Configuration,
    Health,
    Message,
    Query,
    SelectionEvent,
    ServedRequest,
)
from pointit.schemas.system import split_instance
from pointit.schemas.table_types import PresenceHandler
from pointit.schemas.topics import (
    ACT_RESULTS,
    CLOCK,
    CONFIGURATION,
    HEALTH,
    PRESENCES,
    SERVED,
    SERVICE_ALIVE,
    SET_POSE,
    TOPICS,
    Delivery,
    Presence,
    Request,
    Topic,
    topic_of,
)

log = logging.getLogger(__name__)

GRACE_NS = NS_PER_S // 20
"""Time after a recorded request in which a replayed service may send it itself, ns."""

NEAR_NS = NS_PER_S
"""Largest difference of the times at which a service sent a request then and now, ns."""

SETTLE_NS = NS_PER_S // 1000
"""Time after the last entry in which the services answer it, ns."""

MAX_GAP_NS = 600 * NS_PER_S
"""Longest time without entries that is replayed, ns. After a longer one the site's clock has jumped."""

STARTING_NS = NS_PER_S // 20
"""Time after a beginning in mid-session in which services put the states and cues with which they start, ns.
These are not compared: the recorded ones are older."""

LIVE_STARTING_S = 3.0
"""The same on a site from any beginning, s: services take their time to start there."""


class Edge:
    """Writes messages and announces presences on a bus."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._publisher = functools.cache(bus.publisher)
        self._tokens: dict[str, Closable] = {}
        """By key: who is present."""

    def put(self, topic: AnyTopic, name: str, message: Message) -> None:
        """Write `message`."""
        self._publisher(topic, name).put(message)

    def repeat(self, entry: Entry) -> None:
        """Write the message of `entry`, or announce or end the presence that it says.

        Nothing is done for a request, and for the clock: the replay has a time of its own.
        """
        row = entry.row
        body = entry.body
        if isinstance(row, Topic) and isinstance(body, Message) and row is not CLOCK:
            self.put(row, entry.name, body)
        elif isinstance(row, Presence):
            token = self._tokens.pop(entry.key, None)
            if body is True:
                self._tokens[entry.key] = token or self._bus.announce(row, entry.name)
            elif token is not None:
                token.close()


class RecordedRequests:
    """Asks what was asked by pages, commands and other systems.

    A recording does not tell who asked. What the supervisor asks by itself it asks now, too: such a request
    is asked again only if the replayed supervisor has not sent the same one about that time.
    """

    def __init__(self, bus: Bus, clock: RecordingClock, group: asyncio.TaskGroup) -> None:
        self._bus = bus
        self._clock = clock
        self._group = group
        self._mine: list[tuple[str, Query]] = []
        """Keys and queries of this object's requests that are not answered yet."""
        self._seen: list[tuple[int, str, Query]] = []
        """Times, keys and queries of requests of services that stand for no recorded one yet."""

    def on_answered(self, entry: Entry) -> None:
        """Note a request that a replayed service has answered."""
        if entry.row not in CALLED_BY_SERVICES or not isinstance(entry.body, Exchange):
            return
        mine = (entry.key, entry.body.query)
        if mine in self._mine:
            self._mine.remove(mine)
        else:
            self._seen.append((entry.time_ns, *mine))

    def repeat(self, entry: Entry) -> None:
        """Ask the recorded request of `entry`, unless a service does."""
        row = entry.row
        body = entry.body
        if isinstance(row, Request) and isinstance(body, Exchange):
            self._group.create_task(self._repeat(entry, row, body.query), name=f"replayed {entry.key}")

    async def _repeat(self, entry: Entry, row: Request[Any, Any], query: Query) -> None:
        if row in CALLED_BY_SERVICES:
            await self._clock.wait_until(entry.time_ns + GRACE_NS)
            for seen in self._seen:
                if seen[1:] == (entry.key, query) and abs(seen[0] - entry.time_ns) <= NEAR_NS:
                    self._seen.remove(seen)
                    return
            self._mine.append((entry.key, query))
        with contextlib.suppress(RequestError):  # a refusal is published like a reply
            await self._bus.call(row, query, entry.name)


class RecordedResults:
    """Tells the results of acts, each after the event that now stands for the recorded one.

    Two events stand for each other if they are the first, second, … with carriers on their object.
    """

    def __init__(self, edge: Edge) -> None:
        self._edge = edge
        self._recorded: dict[str, list[int]] = {}
        """By object, stamps of the recorded events that services publish again, ns."""
        self._again: dict[str, list[int]] = {}
        """The same of the events that they publish now."""
        self._waiting: list[Entry] = []

    def on_recorded(self, entry: Entry) -> None:
        """Note an event of the recording."""
        _note_act(self._recorded, entry.body)

    def on_again(self, entry: Entry) -> None:
        """Note an event of the replay, and tell what waited for it."""
        _note_act(self._again, entry.body)
        waiting = self._waiting
        self._waiting = []
        for each in waiting:
            self.repeat(each)

    def repeat(self, entry: Entry) -> None:
        """Tell the result of `entry`, or keep it until its event is published again."""
        body = entry.body
        if not isinstance(body, ActResult):
            return
        recorded, again = (each.get(body.object_id, []) for each in (self._recorded, self._again))
        if body.event_ns not in recorded:  # of an event before the beginning, or of the edge
            self._edge.repeat(entry)
        elif (number := recorded.index(body.event_ns)) < len(again):
            self._edge.repeat(entry._replace(body=body.model_copy(update={"event_ns": again[number]})))
        else:
            self._waiting.append(entry)


def _note_act(events: dict[str, list[int]], body: object) -> None:
    if isinstance(body, SelectionEvent) and body.carriers:
        stamps = events.setdefault(body.object_id, [])
        if body.stamp_ns not in stamps:  # an event may be told again
            stamps.append(body.stamp_ns)


class Collector:
    """Hands all messages, answered requests and changes of presence on a bus to a function, each of them."""

    def __init__(self, bus: Bus, clock: Clock, take: Callable[[Entry], None]) -> None:
        self._clock = clock
        self._take = take
        self._declared = [
            bus.subscribe(topic, self._reader(topic), queue_all=True)
            for topic in TOPICS
            if topic is not SERVED
        ]
        self._declared.append(bus.subscribe(SERVED, self._on_served))
        self._watched = [bus.watch(presence, self._watcher(presence)) for presence in PRESENCES]

    @property
    def dropped(self) -> int:
        """Number of messages that came faster than they were taken, and are missing."""
        return sum(declared.traffic.dropped for declared in self._declared)

    def close(self) -> None:
        """Collect no more."""
        for declared in (*self._declared, *self._watched):
            declared.close()

    def _reader(self, topic: AnyTopic) -> Callable[[Any, str], None]:
        def on_message(message: Message, name: str) -> None:
            self._take(Entry(self._clock.now_ns(), topic.at(name), topic, name, message))

        return on_message

    def _on_served(self, served: ServedRequest, instance: str) -> None:
        found = entry_of(served, instance, self._clock.now_ns())
        if found is not None:
            self._take(found)

    def _watcher(self, presence: Presence) -> PresenceHandler:
        def on_change(name: str, *, present: bool) -> None:
            self._take(Entry(self._clock.now_ns(), presence.at(name), presence, name, present))

        return on_change


class Skipped:
    """Numbers of messages that services have not got, or skipped for newer ones, as their health tells."""

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
        if total := sum(self._counts.values()):
            keys = ", ".join(sorted({key for (_, key), count in self._counts.items() if count}))
            log.warning(
                "services skipped %d messages (%s), as this machine is too slow: replay at a lower --speed, "
                "or without --live",
                total,
                keys,
            )


class ReplaySource(Protocol):
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
        """Return begin and end of the first time without entries of more than `longer_ns`, Unix ns."""
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
    """A recording and what of it is done again."""

    source: ReplaySource
    beginning: Beginning
    split: Split
    live: bool = False
    """True if a site takes part, which has a page, a recorder and so on of its own."""
    lights: bool = False
    """True if led-driver drives the strips of its recorded parameters."""


def plan_replay(source: ReplaySource, level: Level) -> ReplayPlan:
    """Return the plan of a replay of `source`.

    Raises:
        ReplayError: None of the services of `level` is in it, or its time jumps.
    """
    if (gap := source.gap(MAX_GAP_NS)) is not None:
        after_s = (gap[0] - source.began_ns) / NS_PER_S
        length_s = (gap[1] - gap[0]) / NS_PER_S
        raise ReplayError(
            f"the recording has nothing for {length_s:.0f} s from {after_s:.1f} s after its beginning: the "
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
            await play(plan, buses, RecordingClock(plan.source.began_ns, speed), folder, listener)
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
        self._edge = Edge(buses.edge)
        starting_ns = LIVE_STARTING_S * clock.speed * NS_PER_S if plan.live else STARTING_NS
        self._started_ns = plan.source.began_ns + starting_ns
        self._skipped = Skipped()
        self._failure: Exception | None = None
        """First error of the listener, which a bus would log and forget."""

    async def play(self, folder: Path, group: asyncio.TaskGroup) -> None:
        room = self._beginning.restore(self._buses.services.site, folder)
        changed: dict[str, dict[str, object]] = {} if self._lights else {"led-driver": {"outputs": []}}
        if room is not None:
            changed["pui"] = {"map": str(room)}
        service_bus = ReplayedServices(self._buses.services, self._clock, group, changed)
        self._requests = RecordedRequests(self._buses.edge, self._clock, group)
        self._results = RecordedResults(self._edge)
        collector = Collector(self._buses.observer, self._clock, self._on_result)
        await self._put_retained(service_bus)
        for entry in self._source.entries():
            if self._beginning.retained.get(entry.key) == entry or self._is_left_out(entry.row, entry.name):
                continue
            await self._wait_until(entry.time_ns)
            if self._split.is_recomputed(entry):
                await self._follow(entry, service_bus)
            elif isinstance(entry.row, Request):
                self._listener.replayed(entry, is_recomputed=False)
            elif entry.row is ACT_RESULTS:
                self._results.repeat(entry)
            else:
                self._edge.repeat(entry)
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

    def _is_left_out(self, row: AnyRow, name: str) -> bool:
        return self._live and is_about_site(row, name)

    async def _wait_until(self, time_ns: int) -> None:
        await self._clock.wait_until(time_ns)
        if self._failure is not None:
            raise self._failure

    async def _put_retained(self, service_bus: ReplayedServices) -> None:
        for topic, name, message in self._beginning.states(self._split, recomputed=False):
            if not self._is_left_out(topic, name):
                self._edge.put(topic, name, message)
        retained = list(self._beginning.states(self._split, recomputed=True))
        topics = list({topic.key: topic for topic, _, _ in retained}.values())
        answers = self._buses.edge.serve_retained(
            topics, lambda wanted: [(name, message) for topic, name, message in retained if topic is wanted]
        )
        asyncio.get_running_loop().call_later(GATHERING_NS / NS_PER_S / self._clock.speed, answers.close)
        configurations = [entry for entry in self._beginning.retained.values() if entry.row is CONFIGURATION]
        for entry in sorted(configurations, key=lambda each: self._split.rank(each.name)):
            service, user = split_instance(entry.name)
            if service == "supervisor":
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
            service, which = split_instance(entry.name)
            if (body.service, body.instance) != (service, entry.name) or body.user not in ("", which):
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
            self._requests.repeat(entry)

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
            self._results.on_again(entry)
        is_start = (self._live or bool(self._beginning.retained)) and self._is_start(entry)
        is_compared = is_recomputed and not is_start and not isinstance(entry.row, Presence)
        self._listener.replayed(entry, is_recomputed=is_compared)


def recorded_outputs(source: ReplaySource) -> list[str]:
    """Return the outputs that led-driver has in `source`, now or later, each as JSON."""
    found: dict[str, None] = {}
    for entry in source.entries(lambda key: key == CONFIGURATION.at("led-driver")):
        if isinstance(entry.body, Configuration):
            with contextlib.suppress(ValueError):  # the replay tells of it
                outputs: object = parameters_of(entry.body).get("outputs")
                if isinstance(outputs, list):
                    found |= dict.fromkeys(json.dumps(each) for each in cast("list[object]", outputs))
    return list(found)


async def play_live(
    plan: ReplayPlan, bus: Bus, listener: ReplayListener, speed: float, *, lights: bool = False
) -> None:
    """Play a recording on the site of `bus`, and publish its time there.

    Raises:
        ReplayError: Services of the recording run on the site already, or cannot be replayed.
    """
    present = await list_present(bus, SERVICE_ALIVE, LISTEN_S)
    own = {each for each in present if split_instance(each)[0] in OBSERVERS}
    if twice := sorted((present - own) & plan.beginning.instances):
        raise ReplayError(
            f"site {bus.site} runs {', '.join(twice)}, as the recording does: end them, or name another site"
        )
    clock = RecordingClock(plan.source.began_ns, speed)
    async with scratch_folder() as folder:
        time = asyncio.create_task(publish_time(clock, bus), name="time of the replay")
        try:
            await play(replace(plan, live=True, lights=lights), Buses(bus, bus, bus), clock, folder, listener)
        finally:
            time.cancel()
            await asyncio.gather(time, return_exceptions=True)
