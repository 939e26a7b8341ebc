"""Bus of a service, which measures messages and durations and holds its warnings and metrics."""

import asyncio
import contextlib
import logging
import math
import weakref
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from pointit.runtime.bus.contract import (
    REQUEST_TIMEOUT_S,
    AnyTopic,
    Bus,
    Closable,
    Declaration,
    Handler,
    Publisher,
    Recall,
    Server,
    Subscription,
    Tap,
    Undecoded,
)
from pointit.runtime.bus.instrumented import (
    DurationWindow,
    InstrumentedPublisher,
    MeteredSubscription,
    ReaderCounts,
    ServedPublisher,
    TopicMeter,
    instrument_handler,
    steady_time,
)
from pointit.runtime.clock import Clock
from pointit.runtime.machine import this_machine
from pointit.schemas import NS_PER_S, Figure, Health, KeyHealth, Message, Query, Reply
from pointit.schemas.problems import MAX_CODE, MAX_SUBJECT, Problem, Severity
from pointit.schemas.table_types import PresenceHandler
from pointit.schemas.topics import ANY, SERVED, Presence, Request, Topic

log = logging.getLogger(__name__)

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)

LOG_PERIOD_S = 1.0
"""Minimum interval of log lines about failing timers, s."""


class ServiceBus:
    """The bus as a service sees it: messages are measured, problems reported, and all ends with the service.

    It adds to a `Bus` what each service would otherwise write itself: rates, ages and delays of all it reads
    and writes, its `Health`, timers that end with it, and the name of its person. A service gets it in its
    `Context` and uses nothing else of the network.

        self.bus.subscribe(topics.RAY, self._on_ray, self.user)     # handler(message, name)
        self._cursors = self.bus.publisher(topics.CURSOR, self.user)
        self.bus.warn("no pose", "no position of anna is known: localize her")     # until warn(..., "")

    A handler that raises does not end the service: the exception is logged and counted, and the next message
    is handled.
    """

    def __init__(self, bus: Bus, clock: Clock, service: str, instance: str, user: str = "") -> None:
        self._bus = bus
        self._clock = clock
        self._service = service
        self._instance = instance
        self._user = user
        self._time_s = steady_time()
        self._began_s = self._reported_s = self._time_s()
        self._meters: dict[tuple[str, str], TopicMeter] = {}
        self._steps = DurationWindow()
        self._latency = DurationWindow(NS_PER_S * clock.speed)
        """Ages of captured data by the service's clock, ns."""
        self._declared: dict[Declaration, None] = {}
        self._publishers: list[Publisher[Any]] = []
        self._tokens: dict[Declaration, None] = {}
        self._problems: dict[tuple[str, str], Problem] = {}
        """By code and subject."""
        self._figures: dict[tuple[str, str], Figure] = {}
        self._errors = 0
        """Number of calls of watchers and timers that raised."""
        self._timers: weakref.WeakSet[asyncio.TimerHandle] = weakref.WeakSet()
        self._logged_s = -math.inf
        self._seq = 0
        self.served: set[str] = set()
        """Keys of the requests that this service answers."""
        self._served: ServedPublisher | None = None

    @property
    def reads(self) -> set[str]:
        """Return the keys of the topics that the service reads."""
        return {key for key, direction in self._meters if direction == "in"}

    @property
    def writes(self) -> set[str]:
        """Return the keys of the topics that the service writes."""
        return {key for key, direction in self._meters if direction == "out"}

    def publisher(self, topic: Topic[M], name: str = "", *, timed: bool = True) -> Publisher[M]:
        """Declare a writer of `topic.at(name)`. If not `timed`, `reached` measures the age of its output."""
        inner = self._bus.publisher(topic, name)
        self._publishers.append(inner)
        latency = self._latency if timed else None
        return InstrumentedPublisher(inner, self._meter(topic, "out"), latency, self._clock)

    def reached(self, latency_s: float) -> None:
        """Record the age of captured data when it leaves the service by another way than the bus."""
        self._latency.values.append(latency_s * self._latency.per_s)

    def subscribe(
        self,
        topic: Topic[M],
        handler: Handler[M],
        name: str = ANY,
        *,
        retained: bool = True,
        queue_all: bool = False,
        drops_late: Callable[[M], object] | None = None,
    ) -> MeteredSubscription:
        """Call `handler(message, name)` for each arriving message.

        `retained`: accept retained states, whose writers may be gone. `queue_all`: accept also replaced
        messages and those older than the newest, for recordings. `drops_late` selects messages that are
        dropped and reported if they arrive much later than earlier ones: services must not act on messages
        that a bad link has delayed.
        """
        meter = self._meter(topic, "in")
        counts = ReaderCounts()
        counted = instrument_handler(
            handler, meter, self._steps, self._clock, drops_late, counts=counts, in_order=not queue_all
        )
        subscription = self._bus.subscribe(topic, counted, name, retained=retained, queue_all=queue_all)
        return MeteredSubscription(subscription, self._declared, meter, counts)

    def tap(self, topic: AnyTopic, handler: Tap, name: str = ANY) -> Subscription:
        """Call `handler` for every message at once, on the thread on which it arrives."""
        meter = self._meter(topic, "in")

        def counted(arrived: Message | Undecoded, key_name: str) -> None:
            meter.count += 1
            meter.newest_s = self._time_s()
            handler(arrived, key_name)

        subscription = self._bus.tap(topic, counted, name)
        return MeteredSubscription(subscription, self._declared, meter, ReaderCounts())

    def serve_retained(self, topics: Sequence[AnyTopic], recall: Recall) -> Closable:
        """Answer for the writers of `topics`, which are states, that are gone."""
        return Declaration(self._bus.serve_retained(topics, recall).close, self._declared)

    def serve(self, request: Request[Q, R], server: Server[Q, R], name: str = ANY) -> Closable:
        """Answer `request`."""
        self.served.add(request.key)
        if self._served is None:
            publisher = self.account(SERVED)
            self._served = ServedPublisher(
                publisher, self._clock, service=self._service, instance=self._instance
            )
        served = self._bus.serve(request, self._served.reporting(request, server), name)
        return Declaration(served.close, self._declared)

    async def call(
        self, request: Request[Q, R], query: Q, name: str = "", *, timeout_s: float = REQUEST_TIMEOUT_S
    ) -> R:
        """Return the reply of the server of `request`."""
        return await self._bus.call(request, query, name, timeout_s=timeout_s)

    def announce(self, presence: Presence, name: str) -> Closable:
        """Be present under `name` until closed."""
        return Declaration(self._bus.announce(presence, name).close, self._tokens)

    def watch(self, presence: Presence, handler: PresenceHandler) -> Closable:
        """Call `handler(name, present=…)` now and on every change."""

        def counted(name: str, *, present: bool) -> None:
            try:
                handler(name, present=present)
            except Exception:
                self._errors += 1
                raise

        return Declaration(self._bus.watch(presence, counted).close, self._declared)

    def call_later(self, delay_s: float, callback: Callable[[], None]) -> asyncio.TimerHandle:
        """Call `callback` in the loop after `delay_s` of the wall, unless the service has ended by then.

        Like the loop's `call_later`, but errors are counted in health and logged, at most once a second.
        """

        def guarded() -> None:
            try:
                callback()
            except Exception:  # an error of one timer must not stop the others
                self._errors += 1
                now_s = self._time_s()
                if now_s - self._logged_s >= LOG_PERIOD_S:
                    self._logged_s = now_s
                    log.exception("timer of %s failed (%d errors so far)", self._instance, self._errors)

        timer = asyncio.get_running_loop().call_later(delay_s, guarded)
        self._timers.add(timer)
        return timer

    @property
    def site(self) -> str:
        """Return the name of the site."""
        return self._bus.site

    @property
    def problem(self) -> str:
        """Return a message if the bus itself has a problem, else `""`."""
        return self._bus.problem

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Return the problems of the bus itself."""
        return self._bus.problems

    @property
    def is_closed(self) -> bool:
        """Return True if the bus below is closed."""
        return self._bus.is_closed

    async def close(self) -> None:
        """Close all declarations of this service, its presence last. The bus itself stays open."""
        for timer in self._timers:
            timer.cancel()
        with contextlib.ExitStack() as stack:
            for token in self._tokens:
                stack.callback(token.close)
            for publisher in self._publishers:
                stack.callback(publisher.close_nowait)
            for declared in self._declared:
                stack.callback(declared.close)
            self._tokens.clear()
            self._publishers.clear()
            self._declared.clear()

    def warn(self, code: str, sentence: str, subject: str = "", *, severity: Severity = "warning") -> None:
        """Show `sentence` (problem, remedy) in health until `clear(code, subject)`. `""` also clears it."""
        if sentence:
            self._problems[code, subject] = Problem(
                code=code[:MAX_CODE], sentence=sentence, subject=subject[:MAX_SUBJECT], severity=severity
            )
        else:
            self._problems.pop((code, subject), None)

    def clear(self, code: str, subject: str = "") -> None:
        """Clear the warning."""
        self._problems.pop((code, subject), None)

    def has_warning(self, code: str, subject: str = "") -> bool:
        """Return True if that warning is shown."""
        return (code, subject) in self._problems

    def set_metric(self, name: str, value: float | None, unit: str = "", part: str = "") -> None:
        """Show a metric, as in `("drift", 0.4, "°/min")`, of the service or a `part`. None removes it."""
        if value is None or not math.isfinite(value):
            self._figures.pop((name, part), None)
        else:
            self._figures[name, part] = Figure(name=name, value=value, unit=unit)

    def _shown_metrics(self) -> tuple[Figure, ...]:
        """Return the metrics. If several have one name, those of parts get the part's name as well."""
        uses = Counter(name for name, _ in self._figures)
        metrics: list[Figure] = []
        for (name, part), figure in list(self._figures.items()):
            shown = figure
            if part and uses[name] > 1:
                label = f"{name} of {part}"
                shown = figure.model_copy(update={"name": label[:64]})
            metrics.append(shown)
        return tuple(metrics)

    def report(self) -> Health:
        """Return the health report of the time since the last one."""
        now_s = self._time_s()
        span_s = max(now_s - self._reported_s, 1e-3)
        self._reported_s = now_s
        # Rates are those since the last report. Problems of the bus come first, then those of topics
        keys: list[KeyHealth] = []
        unmasked = list(self._bus.problems)
        errors = self._errors
        for (key, direction), meter in self._meters.items():
            totals = meter.totals()
            errors += totals.errors
            keys.append(
                KeyHealth(
                    key=key,
                    direction="in" if direction == "in" else "out",
                    rate_hz=meter.count / span_s,
                    age_s=meter.age_s(now_s),
                    dropped=totals.dropped,
                    lost=totals.lost,
                    invalid=totals.invalid,
                )
            )
            meter.count = 0
            unmasked += meter.problems(totals, now_s, self._user)
        self._seq += 1
        self._latency.per_s = NS_PER_S * self._clock.speed  # a site may change its speed

        # Those that the service itself reports
        unmasked += self._problems.values()
        problems = tuple(problem.without_secrets() for problem in unmasked)
        warnings = tuple(problem.sentence for problem in problems if problem.severity == "warning")
        return Health(
            stamp_ns=this_machine().now_ns(),
            seq=self._seq,
            service=self._service,
            instance=self._instance,
            user=self._user,
            pid=this_machine().process_id,
            host=this_machine().host_name,
            uptime_s=now_s - self._began_s,
            keys=tuple(keys),
            step=self._steps.take(),
            latency=self._latency.take(),
            errors=errors,
            status="degraded" if warnings else "ok",
            warnings=warnings,
            problems=problems,
            figures=self._shown_metrics(),
        )

    def account(self, topic: Topic[M]) -> Publisher[M]:
        """Declare the writer of this service's key of `topic`, one of `ACCOUNTS`. Health does not show it."""
        publisher = self._bus.publisher(topic, self._instance)
        self._publishers.append(publisher)
        return publisher

    def _meter(self, topic: Topic[Any], direction: str) -> TopicMeter:
        return self._meters.setdefault((topic.key, direction), TopicMeter(topic))
