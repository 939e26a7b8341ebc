"""`pointit trace USER`: one person's samples from capture to light, hop by hop."""

import asyncio
import datetime as dt
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field

import click
import numpy as np

from pointit.cli.common.output import (
    OutputSection,
    Row,
    console,
    json_option,
    print_table,
    progress,
    say,
    to_json,
    write_line,
)
from pointit.cli.common.panels import PanelCommand
from pointit.cli.common.site_link import SiteAddress, site_command
from pointit.diagnosis.observation import silence_reason
from pointit.runtime.bus.contract import AnyTopic, Bus, Sent, Tap, Undecoded
from pointit.runtime.bus.timeliness import ClockSkewMonitor
from pointit.runtime.errors import AccessDeniedError, NoMessageError
from pointit.runtime.machine import this_machine
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import NS_PER_S, ClockTick, DecodeError, Health, Message, StripsFrame, topics
from pointit.schemas.system import split_instance
from pointit.services.registry import present_writers
from pointit.site.following import follow_site
from pointit.site.site_state import SiteState

CAPTURE = "capture"
LIGHT = "light"

CAUSES: Mapping[str, str] = {
    "imu": CAPTURE,
    "ray": "imu",
    "cursor": "ray",
    "hover": "cursor",
    "frame": "cursor",
    LIGHT: "frame",
}
"""All hops in order, with the hop that causes each."""

SHARED = frozenset(("frame", LIGHT))
"""Hops that messages about other people reach, too. They begin no sample."""

SETTLE_S = 0.5
"""Time from the first message of a sample until it is judged, s. Later messages of it count as lost."""

MAX_OPEN = 4096
"""Maximum number of samples that wait, and of those that are remembered as judged."""

TOPICS: Mapping[str, AnyTopic] = {
    "imu": topics.IMU,
    "ray": topics.RAY,
    "cursor": topics.CURSOR,
    "hover": topics.HOVER,
    "frame": topics.STRIPS_FRAME,
}
"""Topics of the hops that are messages."""

SILENCE_S = 3.0
"""Time without a new sample after which none is waited for."""

LOOK_S = 0.1
"""Interval at which arrived messages are joined."""

MAX_WAITING = 65536
"""Maximum number of messages between two of these times; the oldest are dropped."""


@dataclass(slots=True)
class SamplePath:
    """One sample: when and by which process it was published at each hop."""

    stamp_ns: int
    """Time of capture, by which its messages are found."""
    at_ns: dict[str, int]
    """Time of publication by hop, and of `CAPTURE`; wall time, Unix ns."""
    first_s: float = 0.0
    """Arrival of its first message, s (monotonic)."""
    processes: dict[str, str] = field(default_factory=dict[str, str])

    def delta_s(self, hop: str) -> float | None:
        """Return the time since the hop before, s, or None if either was not seen."""
        return self._span_s(CAUSES[hop], hop)

    def total_s(self, hop: str) -> float | None:
        """Return the time since capture, s, or None if the hop was not seen."""
        return self._span_s(CAPTURE, hop)

    def _span_s(self, begin: str, end: str) -> float | None:
        if begin not in self.at_ns or end not in self.at_ns:
            return None
        return (self.at_ns[end] - self.at_ns[begin]) / NS_PER_S


class PathJoiner:
    """Joins messages of one person, whatever their order, into samples."""

    def __init__(self, wall_ns: Callable[[int], int], began_s: float) -> None:
        """Begin without samples.

        Args:
            wall_ns: converts a capture time (of the site's clock) to wall time, both Unix ns.
            began_s: start of listening, s (monotonic). Samples that first arrive within `SETTLE_S` are
                omitted: their first messages may have been missed.
        """
        self._wall_ns = wall_ns
        self._ready_s = began_s + SETTLE_S
        self._open: OrderedDict[int, SamplePath] = OrderedDict()
        self._judged: OrderedDict[int, None] = OrderedDict()

    def add(self, hop: str, stamp_ns: int, sent_ns: int, process: str, now_s: float) -> None:
        """Add a message. Of several for the same hop, the first one published counts.

        Args:
            hop: a key of `CAUSES`.
            stamp_ns: its time of capture.
            sent_ns: its publication, wall time, Unix ns.
            process: id of the publishing process, or `""` if unknown.
            now_s: the present time, s (monotonic).
        """
        if stamp_ns in self._judged:
            return
        path = self._open.get(stamp_ns)
        if path is None:
            captured_ns = self._wall_ns(stamp_ns)
            path = self._open[stamp_ns] = SamplePath(stamp_ns, {CAPTURE: captured_ns}, now_s)
            if len(self._open) > MAX_OPEN:
                self._open.popitem(last=False)
        if hop not in path.at_ns or sent_ns < path.at_ns[hop]:
            path.at_ns[hop] = sent_ns
            path.processes[hop] = process

    def settled(self, now_s: float) -> list[SamplePath]:
        """Return the samples that are `SETTLE_S` old, in order of arrival, and forget them."""
        paths: list[SamplePath] = []
        while self._open:
            stamp_ns, path = next(iter(self._open.items()))
            if now_s - path.first_s < SETTLE_S:
                break
            del self._open[stamp_ns]
            self._judged[stamp_ns] = None
            if len(self._judged) > MAX_OPEN:
                self._judged.popitem(last=False)
            own_hops = path.at_ns.keys() - SHARED
            if path.first_s >= self._ready_s and own_hops > {CAPTURE}:
                paths.append(path)
        return paths


@dataclass(frozen=True, kw_only=True)
class HopFigures:
    """Times of one hop over several samples, s."""

    hop: str
    after: str
    """The hop before."""
    samples: int
    """Number of samples that reached it."""
    delta_p50_s: float | None
    """Median of the time since the hop before, or None if no sample was seen at both."""
    delta_p99_s: float | None
    total_p50_s: float | None
    """Median of the time since capture."""
    total_p99_s: float | None


def hop_figures(paths: Sequence[SamplePath]) -> list[HopFigures]:
    """Return the figures of each hop that any of `paths` reached, in order."""
    hops: list[HopFigures] = []
    for hop, after in CAUSES.items():
        samples = sum(hop in path.at_ns for path in paths)
        if not samples:
            continue
        figures = HopFigures(
            hop=hop,
            after=after,
            samples=samples,
            delta_p50_s=_quantile(paths, SamplePath.delta_s, hop, 0.5),
            delta_p99_s=_quantile(paths, SamplePath.delta_s, hop, 0.99),
            total_p50_s=_quantile(paths, SamplePath.total_s, hop, 0.5),
            total_p99_s=_quantile(paths, SamplePath.total_s, hop, 0.99),
        )
        hops.append(figures)
    return hops


def farthest(paths: Sequence[SamplePath]) -> SamplePath:
    """Return the newest of the `paths` that were seen at most hops. There must be one."""
    return max(paths, key=lambda path: (len(path.at_ns), path.stamp_ns))


def _quantile(
    paths: Sequence[SamplePath], span_s: Callable[[SamplePath, str], float | None], hop: str, share: float
) -> float | None:
    spans_s: list[float] = []
    for path in paths:
        duration_s = span_s(path, hop)
        if duration_s is not None:
            spans_s.append(duration_s)
    if not spans_s:
        return None
    # Nearest rank: one of the values
    return float(np.quantile(spans_s, share, method="inverted_cdf"))


@site_command("trace", cls=PanelCommand, usual=("count", "watch", "as_json", "connect"))
@click.argument("user")
@click.option("--count", type=click.IntRange(1, 100_000), default=250, help="number of samples to measure")
@click.option("--watch", is_flag=True, help="repeat until Ctrl-C, every --count samples")
@json_option
async def command(site: SiteAddress, user: str, *, count: int, watch: bool, as_json: bool) -> int:
    """Show the path of USER's samples from capture to light, with the time of each hop.

    Every message keeps the capture time of the sample that it is derived from. By this time `trace` finds
    the sample on its way: imu (from the wrist), ray, cursor, hover (selector), frame (pixels of the strips),
    light (the last byte to the slowest controller, as measured by led-driver).

    The first table shows the newest of the samples that reached the most hops. The second is over all
    samples: the share that reached each hop, median and 99th percentile of the time since the hop before
    and since capture, in ms. Times are those of publication by the clock of the publisher's machine.
    Clocks that differ are named.

    A frame carries the time of its newest cursor. With several people, or more samples than frames, only
    some samples are seen in a frame. Lamps and beams carry no capture time.

    On a secured site it must be allowed to read the person's movements: use their own credentials, or the
    supervisor's. The exit code is 1 if no sample came; Ctrl-C ends it with 0. With --json each measurement is
    one object on one line.

    Example: pointit trace user1 --count 500
    """
    topics.check_name(user, "user")
    async with site.join() as bus:
        await _check_rights(bus, user)
        tracer = Tracer(bus, user)
        while True:
            # One measurement after the other: a sample counts in one only
            paths = await _measure(tracer, count)
            is_read = _print_measurement(tracer.trace(paths), count, as_json=as_json)
            if not watch or not is_read:
                return 0


async def _check_rights(bus: ZenohBus, user: str) -> None:
    # Who may read these may read the others
    denied = await bus.denial_reason("reads", topics.IMU, user)
    if denied:
        raise AccessDeniedError(f"{denied} (only {user} and the supervisor may trace samples of {user})")


async def _measure(tracer: "Tracer", count: int) -> list[SamplePath]:
    """Return `count` samples, or as many as come until none follows for `SILENCE_S`; raises if none comes."""
    loop = asyncio.get_running_loop()
    paths: list[SamplePath] = []
    newest_s = loop.time()
    with progress(count) as tell:
        while len(paths) < count and loop.time() - newest_s < SILENCE_S:
            await asyncio.sleep(LOOK_S)
            new_paths = tracer.take()
            if new_paths:
                paths += new_paths
                newest_s = loop.time()
            done = min(len(paths), count)
            tell(f"samples of {tracer.user}", done)
    if not paths:
        raise NoMessageError(tracer.silence())
    return paths[:count]


@dataclass(frozen=True, kw_only=True)
class TracedHop:
    """One hop of one sample."""

    hop: str
    service: str
    """Instance that published it; `""` if unknown."""
    host: str
    at_ns: int
    """Publication, wall time of its machine, Unix ns."""
    delta_s: float | None
    """Time since the hop before, or None if that was not seen."""
    total_s: float | None
    """Time since capture."""


@dataclass(frozen=True, kw_only=True)
class Trace:
    """Result of one measurement."""

    user: str
    samples: int
    stamp_ns: int
    """Time of capture of the sample in `path`, by the site's clock."""
    captured_ns: int
    """The same as wall time, Unix ns."""
    path: tuple[TracedHop, ...]
    hops: tuple[HopFigures, ...]
    clocks: tuple[str, ...]
    """Machines of the path with other clocks than ours, a sentence each."""
    invalid: int
    """Messages that could not be decoded."""


class Tracer:
    """Listens to the messages of one person's samples."""

    def __init__(self, bus: Bus, user: str) -> None:
        self.user = user
        self._loop = asyncio.get_running_loop()
        self._arrived = deque[tuple[str, Message | Undecoded, int]](maxlen=MAX_WAITING)
        self._joiner = PathJoiner(self._wall_ns, self._loop.time())
        self._tick: ClockTick | None = None
        self._reports: dict[str, tuple[str, Health]] = {}
        """By instance: the process that published its newest report, and the report."""
        self._skews = ClockSkewMonitor(this_machine().host_name)
        self._invalid = 0
        bus.subscribe(topics.CLOCK, self._on_tick)
        self._site = SiteState(on_service=self._on_service)
        follow_site(self._site, bus, self._loop.time, ())
        bus.tap(topics.HEALTH, self._tap("health"))
        for hop, topic in TOPICS.items():
            name = user if topic.placeholder == "user" else topics.ANY
            bus.tap(topic, self._tap(hop), name)

    def take(self) -> list[SamplePath]:
        """Return the samples that are complete, or will not be, since the last call."""
        now_s = self._loop.time()
        while self._arrived:
            hop, arrived, arrived_ns = self._arrived.popleft()
            sent = None if isinstance(arrived, Message) else arrived.sent
            at_ns, process = Sent(arrived_ns, "") if sent is None else sent
            try:
                message = arrived if isinstance(arrived, Message) else arrived.decode()
            except DecodeError:
                self._invalid += 1
                continue
            if isinstance(message, Health):
                self._on_health(message, process, arrived_ns, now_s)
                continue
            self._joiner.add(hop, message.stamp_ns, at_ns, process, now_s)
            if isinstance(message, StripsFrame) and message.light_s > 0:
                light_ns = at_ns + round(message.light_s * NS_PER_S)
                self._joiner.add(LIGHT, message.stamp_ns, light_ns, process, now_s)
        return self._joiner.settled(now_s)

    def trace(self, paths: Sequence[SamplePath]) -> Trace:
        """Return the result over `paths`, at least one."""
        newest = farthest(paths)
        path = [self._traced(newest, hop) for hop in CAUSES if hop in newest.at_ns]

        # Clocks of machines that are on the way of any of the samples
        hosts: set[str] = set()
        for sample in paths:
            hosts.update(self._writer(sample, hop)[1] for hop in sample.processes)
        clocks: list[str] = []
        for skew in self._skews.skews(self._loop.time()):
            if skew.host and skew.host in hosts:
                clocks.append(skew.sentence(self._skews.here))
        return Trace(
            user=self.user,
            samples=len(paths),
            stamp_ns=newest.stamp_ns,
            captured_ns=newest.at_ns[CAPTURE],
            path=tuple(path),
            hops=tuple(hop_figures(paths)),
            clocks=tuple(clocks),
            invalid=self._invalid,
        )

    def silence(self) -> str:
        """Return a sentence with the reason that no sample came."""
        reason = silence_reason(topics.IMU, self.user, self._site.services)
        return f"no sample of {self.user} came within {SILENCE_S:g} s: {reason}"

    def _traced(self, path: SamplePath, hop: str) -> TracedHop:
        service, host = self._writer(path, hop)
        return TracedHop(
            hop=hop,
            service=service,
            host=host,
            at_ns=path.at_ns[hop],
            delta_s=path.delta_s(hop),
            total_s=path.total_s(hop),
        )

    def _writer(self, path: SamplePath, hop: str) -> tuple[str, str]:
        """Return instance and host of the publisher of `path` at `hop`, `""` where unknown."""
        topic = TOPICS["frame" if hop == LIGHT else hop]
        writers: list[Health] = []
        for process, health in self._reports.values():
            is_of_process = process == path.processes[hop] and _writes(health, topic)
            if is_of_process and health.user in ("", self.user):
                writers.append(health)

        # A person's own service before the shared ones of the same process
        own = [health for health in writers if split_instance(health.instance)[1] == self.user]
        if own:
            writers = own
        if not writers:
            return _joined(present_writers(topic, self.user, self._site.services)), ""
        instances = _joined(health.instance for health in writers)
        hosts = _joined(health.host for health in writers)
        return instances, hosts

    def _tap(self, hop: str) -> Tap:
        def on_message(arrived: Message | Undecoded, _name: str) -> None:  # on any thread
            self._arrived.append((hop, arrived, this_machine().now_ns()))

        return on_message

    def _on_health(self, health: Health, process: str, arrived_ns: int, now_s: float) -> None:
        self._reports[health.instance] = (process, health)
        self._skews.on_report(health.host, health.stamp_ns, arrived_ns, now_s, health.user)

    def _on_tick(self, tick: ClockTick, _name: str) -> None:
        self._tick = tick

    def _on_service(self, instance: str, present: bool) -> None:
        if not present:
            self._reports.pop(instance, None)

    def _wall_ns(self, stamp_ns: int) -> int:
        """Return the wall time at which the site's clock showed `stamp_ns`."""
        tick = self._tick
        if tick is None:
            return stamp_ns
        return tick.stamp_ns + round((stamp_ns - tick.sim_ns) / tick.speed)


def _writes(health: Health, topic: AnyTopic) -> bool:
    for key in health.keys:
        if key.key == topic.key and key.direction == "out":
            return True
    return False


def _joined(names: Iterable[str]) -> str:
    return " or ".join(sorted(set(names)))


def _print_measurement(trace: Trace, count: int, *, as_json: bool) -> bool:
    """Print one measurement. Return False if the reader of the pipe is gone."""
    if trace.samples < count:
        click.echo(f"only {trace.samples} of {count} samples came, then none for {SILENCE_S:g} s", err=True)
    if trace.invalid:
        click.echo(f"{trace.invalid} messages could not be decoded; see `pointit doctor`", err=True)
    if as_json:
        return write_line(to_json(asdict(trace)))

    # One sample, then all
    screen = console()
    captured = _clock_time(trace.captured_ns)
    sample = OutputSection(
        name="sample",
        about=f"of {trace.user}, captured at {captured} ({trace.stamp_ns})",
        rows=tuple(map(_path_row, trace.path)),
        roomy=frozenset(("host",)),
    )
    print_table(screen, sample)
    services = {traced.hop: traced.service for traced in trace.path}
    hops = OutputSection(
        name="hops",
        about=f"{trace.samples} samples, ms since the hop before and since capture",
        rows=tuple(_hop_row(hop, trace.samples, services.get(hop.hop, "")) for hop in trace.hops),
        roomy=frozenset(("service",)),
    )
    print_table(screen, hops)
    for sentence in trace.clocks:
        say(f"warning: {sentence}")
    return True


def _path_row(traced: TracedHop) -> Row:
    return {
        "hop": traced.hop,
        "service": traced.service,
        "host": traced.host,
        "published": _clock_time(traced.at_ns),
        "delta_ms": _ms(traced.delta_s),
        "total_ms": _ms(traced.total_s),
    }


def _hop_row(hop: HopFigures, samples: int, service: str) -> Row:
    return {
        "hop": hop.hop,
        "after": hop.after,
        "service": service,
        "reached_%": round(100 * hop.samples / samples),
        "delta_p50": _ms(hop.delta_p50_s),
        "delta_p99": _ms(hop.delta_p99_s),
        "total_p50": _ms(hop.total_p50_s),
        "total_p99": _ms(hop.total_p99_s),
    }


def _clock_time(at_ns: int) -> str:
    """Return the local time of day, µs."""
    seconds, rest_ns = divmod(at_ns, NS_PER_S)
    at = dt.datetime.fromtimestamp(seconds).astimezone()
    return f"{at:%H:%M:%S}.{rest_ns // 1000:06d}"


def _ms(value_s: float | None) -> float | None:
    return None if value_s is None else round(value_s * 1e3, 3)
