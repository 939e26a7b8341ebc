"""`pointit topic echo` and `pointit topic hz`: messages as they arrive, and their rates."""

import asyncio
import difflib
import functools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import chain
from typing import Any

import click

from pointit.cli.common.lazy import UnknownNameError
from pointit.cli.common.output import (
    OutputSection,
    Row,
    console,
    json_option,
    print_table,
    to_json,
    to_line,
    write_line,
)
from pointit.cli.common.panels import Finite
from pointit.cli.common.site_link import SiteAddress, site_command
from pointit.cli.inspect.pose_errors import PoseErrors, TruthRow, print_errors
from pointit.diagnosis.observation import silence_reason
from pointit.runtime.bus.contract import AnyTopic, Bus, Subscription
from pointit.runtime.clock import wait_up_to
from pointit.runtime.service.process import EXIT_FAILED
from pointit.schemas import KeyNameError, Message, encode
from pointit.schemas.topics import ANY, IMU, OBJECTS, POSE, PRESENCES, REQUESTS, TOPICS, Delivery, Topic
from pointit.services.registry import add_installed
from pointit.site.following import follow_site
from pointit.site.site_state import SiteState

Wanted = tuple[AnyTopic, str]
"""A row, and the value of its placeholder: a name, `*` for all, or `""` if it has none."""
Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

EVERYTHING = "**"

SILENCE_S = 2.0
"""Time without a message after which a notice is printed."""


def resolve(typed: str) -> list[Wanted]:
    """Return the topics that match `typed`.

    `users/anna/imu` is one key, `users/*/imu` or `users/{user}/imu` those of all users, `users/anna/*` all
    of anna's, and `**` at the end matches any rest.

    Raises:
        UnknownNameError: If no topic matches; suggests similar keys.
    """
    add_installed()
    parts = typed.strip("/").split("/")
    wanted: list[Wanted] = []
    for topic in TOPICS:
        name = _match(parts, topic.key.split("/"))
        if name is None:
            continue
        try:
            topic.at(name)
        except KeyNameError as error:
            raise UnknownNameError(f"key {typed!r}: {error}") from error
        wanted.append((topic, name))
    if not wanted:
        raise UnknownNameError(f"no topic has the key {typed!r}; {_advice(parts)}")
    return wanted


def resolve_all(typed: Iterable[str]) -> list[Wanted]:
    """Return the topics that match any of `typed`, each row and name once."""
    matches = chain.from_iterable(map(resolve, typed))
    return list(dict.fromkeys(matches))


def _match(parts: Sequence[str], pattern: Sequence[str]) -> str | None:
    """Return the part for the placeholder of `pattern`, `""` if it has none, or None if it does not match."""
    if parts[-1] == EVERYTHING:
        head = parts[:-1]
        rest = [ANY] * (len(pattern) - len(head))
        parts = [*head, *rest]
    if len(parts) != len(pattern):
        return None
    name = ""
    for part, own in zip(parts, pattern, strict=True):
        if _is_placeholder(own):
            name = ANY if part in (ANY, own) else part
        elif part not in (ANY, own):
            return None
    return name


def _advice(parts: Sequence[str]) -> str:
    # The commands for topics, requests and presence are easily confused
    for kind, rows in (("something to ask for", REQUESTS), ("presence", PRESENCES)):
        for row in rows:
            if _match(parts, row.key.split("/")) is not None:
                hint = "; ask with `pointit service call`" if rows is REQUESTS else ""
                return f"{row.key} is {kind} ({row.about}), not a topic{hint}"
    known = [filled(topic.key, parts) for topic in TOPICS]
    near = difflib.get_close_matches("/".join(parts), known, n=3, cutoff=0.5)
    if near:
        return f"did you mean {' or '.join(near)}?"
    return "`pointit topic list` shows them all"


def filled(key: str, parts: Sequence[str]) -> str:
    """Return `key` with the placeholder replaced by the typed part."""
    own = key.split("/")
    for position, part in enumerate(own):
        typed = parts[position] if position < len(parts) else ""
        if typed and _is_placeholder(part):
            own[position] = typed
    return "/".join(own)


def _is_placeholder(part: str) -> bool:
    return part.startswith("{")


@site_command("echo")
@click.argument("key")
@click.option("--count", type=click.IntRange(min=1), help="number of messages to print before exit")
@json_option
async def echo(site: SiteAddress, key: str, *, count: int | None, as_json: bool) -> int:
    """Print the messages on KEY as they arrive, one per line.

    KEY is users/anna/imu, or for all users 'users/*/imu' or users/{user}/imu; 'users/anna/*' is all of
    anna's. Lines are YAML; with --json objects whose first field is the key, bytes as hexadecimal text.
    Ctrl-C ends it with exit code 0.

    Example: pointit topic echo 'users/*/cursor' --count 3
    """
    wanted = resolve(key)
    loop = asyncio.get_running_loop()
    async with site.join() as bus:
        printer = _Printer(count, as_json=as_json)
        state = SiteState()
        follow_site(state, bus, loop.time, ())
        for topic, name in wanted:
            bus.subscribe(topic, functools.partial(printer.show, topic), name or ANY)

        # A notice after each silence, once for the same newest message
        printed_s: float | None = None
        while not printer.done.is_set():
            wait_s = printer.newest_s + SILENCE_S - loop.time()
            if wait_s <= 0:
                if printed_s != printer.newest_s:
                    printed_s = printer.newest_s
                    _tell_silence(key, wanted, state.services, any_yet=printer.shown > 0)
                wait_s = SILENCE_S
            await wait_up_to(printer.done, wait_s)
    return 0


class _Printer:
    """Prints messages until `count` is reached or the reader of the pipe is gone."""

    def __init__(self, count: int | None, *, as_json: bool) -> None:
        self._now_s = asyncio.get_running_loop().time
        self.done = asyncio.Event()
        self.shown = 0
        self.newest_s = self._now_s()
        """Time of the newest message, or of the start."""
        self._count = count
        self._as_json = as_json

    def show(self, topic: Topic[Message], message: Message, name: str) -> None:
        if self.done.is_set():
            return
        if not write_line(format_message(topic.at(name), message, as_json=self._as_json)):
            self.done.set()
            return
        self.shown += 1
        self.newest_s = self._now_s()
        if self._count is not None and self.shown >= self._count:
            self.done.set()


def format_message(key: str, message: Message, *, as_json: bool) -> str:
    """Return `message` on one line, as YAML or as a JSON object that starts with the key."""
    fields = message.model_dump()
    if as_json:
        return to_json({"key": key, **fields})
    return f"{key}: {to_line(fields)}"


def _tell_silence(key: str, wanted: list[Wanted], present: frozenset[str], *, any_yet: bool) -> None:
    """Print a notice to standard error; topics that change rarely may be silent after a message."""
    is_periodic = any(topic.delivery is Delivery.LATEST for topic, _ in wanted)
    if any_yet and not is_periodic:
        return
    if len(wanted) == 1:
        ((topic, name),) = wanted
        reason = silence_reason(topic, name, present)
    else:
        reason = f"present: {', '.join(sorted(present)) or 'no service'}"
    nothing = "nothing more" if any_yet else "nothing"
    click.echo(f"waiting: {nothing} on {key} for {SILENCE_S:g} s; {reason}", err=True)


def window_options(default_s: float, note: str = "") -> Decorator:
    """Return the options `--window` (`window_s`) and `--watch`; `note` ends the help of the first."""

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        watch = click.option("--watch", is_flag=True, help="repeat until Ctrl-C, once a window")
        window = click.option(
            "--window", "window_s", type=Finite(min=0.1), default=default_s, help=f"measuring time, s{note}"
        )
        return window(watch(function))

    return add


@dataclass(frozen=True, kw_only=True)
class TopicRate:
    """One key over one window."""

    key: str
    messages: int
    rate_hz: float | None
    """Mean rate from the first to the last message, or None for fewer than two."""
    nominal_hz: float | None
    """Rate in the topic table, or None if messages come on change."""
    period_min_s: float | None
    period_max_s: float | None
    """Longest period, including the one up to the end of the window."""
    jitter_s: float | None
    """Standard deviation of the periods."""
    bytes_per_s: float


class RateMeter:
    """Measures one key from sums, without storing messages."""

    def __init__(self, key: str, nominal_hz: float | None = None) -> None:
        self._key = key
        self._nominal_hz = nominal_hz
        self._last_s: float | None = None
        self._reset()

    def _reset(self) -> None:
        self._messages = self._bytes = self._periods = 0
        self._mean_s = self._squares_s2 = 0.0
        self._min_s = math.inf
        self._max_s = 0.0

    def add(self, now_s: float, size: int) -> None:
        """Count a message of `size` bytes received at `now_s`."""
        if self._last_s is not None:
            period_s = now_s - self._last_s
            self._periods += 1
            self._min_s = min(self._min_s, period_s)
            self._max_s = max(self._max_s, period_s)
            step_s = period_s - self._mean_s  # Welford's running variance
            self._mean_s += step_s / self._periods
            self._squares_s2 += step_s * (period_s - self._mean_s)
        self._last_s = now_s
        self._messages += 1
        self._bytes += size

    def take(self, now_s: float, window_s: float) -> TopicRate:
        """Return the rate in the last `window_s` until `now_s`, and start the next window."""
        rate_hz: float | None = None
        period_min_s: float | None = None
        period_max_s: float | None = None
        jitter_s: float | None = None
        if self._last_s is not None and self._periods > 0:
            if self._mean_s > 0:
                rate_hz = 1.0 / self._mean_s
            period_min_s = self._min_s
            period_max_s = max(self._max_s, now_s - self._last_s)
            jitter_s = math.sqrt(self._squares_s2 / self._periods)
        rate = TopicRate(
            key=self._key,
            messages=self._messages,
            rate_hz=rate_hz,
            nominal_hz=self._nominal_hz,
            period_min_s=period_min_s,
            period_max_s=period_max_s,
            jitter_s=jitter_s,
            bytes_per_s=self._bytes / window_s,
        )
        self._reset()
        return rate


@site_command("hz")
@click.argument("keys", nargs=-1, metavar="[KEY]...")
@click.option("--all", "everything", is_flag=True, help="every topic")
@window_options(5.0)
@json_option
async def hz(
    site: SiteAddress, keys: tuple[str, ...], *, everything: bool, window_s: float, watch: bool, as_json: bool
) -> int:
    """Measure rate, jitter and bandwidth of the messages on each KEY.

    KEY is as for `pointit topic echo`. For objects and poses, localized people whom motion capture also sees
    are compared with their true pose. The exit code is 1 if nothing arrived; Ctrl-C ends it with 0. With
    --json each window is one object on one line.

    Example: pointit topic hz users/anna/imu --watch
    """
    if not keys and not everything:
        raise UnknownNameError(
            f"KEY is missing: name one, such as '{IMU.at(ANY)}', or measure all topics with --all"
        )

    # A key that is named whole is shown even if nothing comes on it
    wanted = resolve_all([EVERYTHING] if everything else keys)
    named = resolve_all([key for key in keys if ANY not in key])
    loop = asyncio.get_running_loop()
    async with site.join() as bus:
        counter = TopicCounter(bus, wanted, named)
        while True:
            await asyncio.sleep(window_s)
            rates = counter.take(loop.time(), window_s)
            conflated = counter.take_conflated()
            truth = counter.pose_errors.take()
            is_read = show_rates(rates, window_s, conflated, truth, as_json=as_json)
            if not watch or not is_read:
                has_message = any(rate.messages for rate in rates)
                return 0 if has_message else EXIT_FAILED


class TopicCounter:
    """A meter for each named key, and for each that appears."""

    def __init__(self, bus: Bus, wanted: list[Wanted], named: list[Wanted]) -> None:
        """Subscribe to `wanted`; keys of `named` count from the beginning."""
        self.pose_errors = PoseErrors()
        self._loop = asyncio.get_running_loop()
        self._meters: dict[str, RateMeter] = {}
        self._conflated = 0
        for topic, name in named:
            if name != ANY:
                self._meter(topic, name)
        self._subscriptions: list[Subscription] = []
        for topic, name in wanted:
            self._subscriptions.append(bus.subscribe(topic, self._handler(topic), name or ANY))
        topics = [topic for topic, _ in wanted]
        if OBJECTS in topics or POSE in topics:
            bus.subscribe(OBJECTS, self.pose_errors.add)
            bus.subscribe(POSE, self.pose_errors.add)

    def take(self, now_s: float, window_s: float) -> list[TopicRate]:
        """Return the rates in the last `window_s` by key, and start the next window."""
        meters = [self._meters[key] for key in sorted(self._meters)]
        return [meter.take(now_s, window_s) for meter in meters]

    def take_conflated(self) -> int:
        """Return the number of messages conflated before they were counted, since the last call."""
        total = sum(subscription.traffic.dropped for subscription in self._subscriptions)
        fresh = total - self._conflated
        self._conflated = total
        return fresh

    def _handler(self, topic: AnyTopic) -> Any:
        def on_message(message: Message, name: str) -> None:
            meter = self._meter(topic, name)
            meter.add(self._loop.time(), len(encode(message)))

        return on_message

    def _meter(self, topic: AnyTopic, name: str) -> RateMeter:
        key = topic.at(name)
        if key not in self._meters:
            self._meters[key] = RateMeter(key, topic.rate_hz)
        return self._meters[key]


def show_rates(
    rates: list[TopicRate], window_s: float, conflated: int, truth: tuple[TruthRow, ...], *, as_json: bool
) -> bool:
    """Print one window. Return False if the reader of the pipe is gone."""
    if conflated:
        click.echo(
            f"{conflated} messages came faster than they could be counted: rates are too low", err=True
        )

    # One object on a line for programs, which read window by window
    if as_json:
        keys = list(map(asdict, rates))
        errors = list(map(asdict, truth))
        return write_line(to_json({"window_s": window_s, "keys": keys, "truth": errors}))

    if not rates:
        click.echo(f"nothing came within {window_s:g} s; see `pointit doctor`", err=True)
        return True
    rows = tuple(map(_rate_row, rates))
    section = OutputSection(name="rates", about=f"over {window_s:g} s", rows=rows)
    print_table(console(), section)
    print_errors(console(), truth)
    return True


def _rate_row(rate: TopicRate) -> Row:
    return {
        "key": rate.key,
        "messages": rate.messages,
        "rate_hz": rate.rate_hz,
        "nominal_hz": rate.nominal_hz,
        "min_ms": _ms(rate.period_min_s),
        "max_ms": _ms(rate.period_max_s),
        "jitter_ms": _ms(rate.jitter_s),
        "bytes/s": round(rate.bytes_per_s),
    }


def _ms(value_s: float | None) -> float | None:
    return None if value_s is None else value_s * 1e3
