"""`pointit topic hz`: rates against the nominal ones."""

import asyncio
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Unpack

import click

from pointit.cli.common.lazy import UnknownNameError
from pointit.cli.common.option_types import Finite
from pointit.cli.common.output import OutputSection, console, json_option, print_table, to_json, write_line
from pointit.cli.common.site_link import AtSite, join_site, quiet, site_options
from pointit.cli.inspect.pose_errors import PoseErrors, TruthRow, print_errors
from pointit.cli.inspect.topic_names import EVERYTHING, Wanted, resolve_all
from pointit.runtime.bus.contract import AnyTopic, Bus
from pointit.runtime.service.shutdown import EXIT_FAILED, run_until_shutdown
from pointit.schemas import Message, encode
from pointit.schemas.topics import ANY, IMU, OBJECTS, POSE

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


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
        self._min_s, self._max_s = math.inf, 0.0

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
        known = self._periods > 0
        silence_s = 0.0 if self._last_s is None else now_s - self._last_s
        rate = TopicRate(
            key=self._key,
            messages=self._messages,
            rate_hz=1.0 / self._mean_s if known and self._mean_s > 0 else None,
            nominal_hz=self._nominal_hz,
            period_min_s=self._min_s if known else None,
            period_max_s=max(self._max_s, silence_s) if known else None,
            jitter_s=math.sqrt(self._squares_s2 / self._periods) if known else None,
            bytes_per_s=self._bytes / window_s,
        )
        self._reset()
        return rate


@click.command("hz", params=site_options())
@click.argument("keys", nargs=-1, metavar="[KEY]...")
@click.option("--all", "everything", is_flag=True, help="every topic")
@window_options(5.0)
@json_option
def command(
    keys: tuple[str, ...],
    *,
    everything: bool,
    window_s: float,
    watch: bool,
    as_json: bool,
    **at: Unpack[AtSite],
) -> int:
    """Measure rate, jitter and bandwidth of the messages on each KEY.

    KEY is as for `pointit topic echo`. With objects or poses, localized people whom motion capture sees, too,
    are compared with their true pose. The exit code is 1 if nothing arrived; Ctrl-C ends it with 0.
    With --json each window is one object on one line.

    Example: pointit topic hz users/anna/imu --watch
    """
    if not keys and not everything:
        raise UnknownNameError(
            f"KEY is missing: name one, such as '{IMU.at(ANY)}', or measure all topics with --all"
        )
    wanted = resolve_all([EVERYTHING] if everything else keys)
    named = resolve_all(key for key in keys if ANY not in key)
    quiet()
    return run_until_shutdown(_measure(wanted, named, window_s, watch=watch, as_json=as_json, **at))


async def _measure(
    wanted: list[Wanted],
    named: list[Wanted],
    window_s: float,
    *,
    watch: bool,
    as_json: bool,
    **at: Unpack[AtSite],
) -> int:
    loop = asyncio.get_running_loop()
    async with join_site(**at) as bus:
        counter = TopicCounter(bus, wanted, named)
        while True:
            await asyncio.sleep(window_s)
            rates = counter.take(loop.time(), window_s)
            conflated, truth = counter.take_conflated(), counter.pose_errors.take()
            read_on = show(rates, window_s, conflated, truth, as_json=as_json)
            if not (watch and read_on):
                return 0 if any(rate.messages for rate in rates) else EXIT_FAILED


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
        self._subscriptions = [bus.subscribe(row, self._handler(row), name or ANY) for row, name in wanted]
        topics = [row for row, _ in wanted]
        if OBJECTS in topics or POSE in topics:
            bus.subscribe(OBJECTS, self.pose_errors.add)
            bus.subscribe(POSE, self.pose_errors.add)

    def take(self, now_s: float, window_s: float) -> list[TopicRate]:
        """Return the rates in the last `window_s` by key, and start the next window."""
        return [self._meters[key].take(now_s, window_s) for key in sorted(self._meters)]

    def take_conflated(self) -> int:
        """Return the number of messages conflated before they were counted, since the last call."""
        total = sum(subscription.traffic.dropped for subscription in self._subscriptions)
        fresh, self._conflated = total - self._conflated, total
        return fresh

    def _handler(self, topic: AnyTopic) -> Any:
        def on_message(message: Message, name: str) -> None:
            self._meter(topic, name).add(self._loop.time(), len(encode(message)))

        return on_message

    def _meter(self, topic: AnyTopic, name: str) -> RateMeter:
        key = topic.at(name)
        if key not in self._meters:
            self._meters[key] = RateMeter(key, topic.rate_hz)
        return self._meters[key]


def show(
    rates: list[TopicRate], window_s: float, conflated: int, truth: tuple[TruthRow, ...], *, as_json: bool
) -> bool:
    """Print one window. Return False if the reader of the pipe is gone."""
    if conflated:
        click.echo(
            f"{conflated} messages came faster than they could be counted: rates are too low", err=True
        )
    if as_json:
        shown = {"keys": [asdict(rate) for rate in rates], "truth": [asdict(row) for row in truth]}
        return write_line(to_json({"window_s": window_s, **shown}))
    rows = tuple(
        {
            "key": rate.key,
            "messages": rate.messages,
            "rate_hz": rate.rate_hz,
            "nominal_hz": rate.nominal_hz,
            "min_ms": _ms(rate.period_min_s),
            "max_ms": _ms(rate.period_max_s),
            "jitter_ms": _ms(rate.jitter_s),
            "bytes/s": round(rate.bytes_per_s),
        }
        for rate in rates
    )
    if rows:
        print_table(console(), OutputSection(name="rates", about=f"over {window_s:g} s", rows=rows))
        print_errors(console(), truth)
    else:
        click.echo(f"nothing came within {window_s:g} s; see `pointit doctor`", err=True)
    return True


def _ms(value_s: float | None) -> float | None:
    return None if value_s is None else value_s * 1e3
