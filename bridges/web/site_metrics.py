"""Metrics of a site, from the messages that its services publish anyway, with totals that only grow. Pure."""

from collections import Counter, OrderedDict, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate, islice
from typing import TYPE_CHECKING, NamedTuple

from pointit.diagnosis.observation import expected_services
from pointit.geometry.floor_sigma import position_sigma_m, yaw_sigma_rad
from pointit.schemas import NS_PER_S, Health, KeyHealth, Localization, Quantiles, SelectionEvent
from pointit.schemas.system import DURATION_BOUNDS_S, split_instance
from pointit.schemas.topics import DEPLOYMENT, HEALTH, LOCALIZATION, OUTCOMES, POSE, SELECTION_EVENTS, TOPICS
from pointit.services.registry import names
from pointit.site.site_state import Change, SiteState

if TYPE_CHECKING:
    from prometheus_client.metrics_core import (
        CounterMetricFamily,
        GaugeMetricFamily,
        HistogramMetricFamily,
        Metric,
    )


Row = tuple[Sequence[str], float]
"""Values of the labels, and the value, of one series of a family."""
Rows = Iterable[Row]

MAX_INSTANCES = 4096
"""Maximum number of instances whose last report is stored; the oldest is dropped."""

MAX_TOPICS = 64
"""Maximum number of topics in a report that are counted."""

OTHER = "other"
"""Label for keys that are no row of the topic table, and unknown services; bounds the number of series."""

KNOWN_KEYS = frozenset(topic.key for topic in TOPICS)

BUCKETS = (*map(str, DURATION_BOUNDS_S), "+Inf")

READS = (HEALTH, POSE, LOCALIZATION, SELECTION_EVENTS, OUTCOMES, DEPLOYMENT)
"""Topics that metrics are made from."""

MAX_USERS = 1024
"""Maximum number of people with metrics of their own."""

MAX_DEPLOYMENTS = 1024

ROUTER = "router"
"""Kind of routers. One of several is the instance `router-MACHINE`."""

KINDS = frozenset({ROUTER, *names()})
"""Services with a label of their own: those that are installed here."""

BATTERIES = ("battery", "battery of the phone")
"""Figures of imu-bridge with the charge of a wrist, %."""

RESULTS = ("solved", "refused", "cancelled")
"""Phases in which a localization ends."""


class Labels(NamedTuple):
    """Labels of one total. Those that a counter does not have are `""`."""

    counter: str
    """`messages`, `discarded`, `errors` or `refused`."""
    service: str
    topic: str = ""
    kind: str = ""
    """Direction of messages, or the reason why they were discarded."""


class Totals:
    """Sums the counters of services over their instances and restarts."""

    def __init__(self) -> None:
        self.values: defaultdict[Labels, float] = defaultdict(float)
        self._last: OrderedDict[str, tuple[Health, dict[Labels, float]]] = OrderedDict()

    def add(self, instance: str, service: str, health: Health) -> None:
        """Add what `instance` has counted since its last report.

        What it counted before its first report here is not added, nor is a report that comes late.
        """
        keys = _keys(health)
        counts = dict(_counts(service, health, keys))
        previous, previous_counts = self._last.pop(instance, (None, dict[Labels, float]()))

        # Since when it has counted: its last report, or its own start
        since_s = 0.0
        """Uptime at which the rates of this report begin."""
        if previous is None:
            if health.seq != 1:  # it runs for longer than anybody listens here
                since_s = health.uptime_s
                previous_counts = counts
        elif (health.uptime_s, health.seq) > (previous.uptime_s, previous.seq):
            since_s = previous.uptime_s
        elif health.stamp_ns <= previous.stamp_ns:
            self._last[instance] = (previous, previous_counts)
            return
        else:
            previous_counts = {}  # restarted

        for labels, count in counts.items():
            # a counter below its last value has started again
            previous_count = previous_counts.get(labels, 0.0)
            self.values[labels] += count - previous_count if count >= previous_count else count
        for key in keys:
            labels = Labels("messages", service, key.key, key.direction)
            self.values[labels] += round(key.rate_hz * (health.uptime_s - since_s))

        # The newest report stands at the end, the oldest is dropped
        self._last[instance] = (health, counts)
        if len(self._last) > MAX_INSTANCES:
            self._last.popitem(last=False)


def _keys(health: Health) -> list[KeyHealth]:
    """Return the keys of a report, with unknown ones under one name."""
    keys: list[KeyHealth] = []
    for key in health.keys[:MAX_TOPICS]:
        is_known = key.key in KNOWN_KEYS
        keys.append(key if is_known else key.model_copy(update={"key": OTHER}))
    return keys


def _counts(service: str, health: Health, keys: Iterable[KeyHealth]) -> Iterator[tuple[Labels, float]]:
    yield Labels("errors", service), health.errors
    discarded: Counter[Labels] = Counter()
    for key in keys:
        if key.direction != "in":
            continue
        for reason, count in (("dropped", key.dropped), ("lost", key.lost), ("invalid", key.invalid)):
            labels = Labels("discarded", service, key.key, reason)
            discarded[labels] += count
    yield from discarded.items()
    for figure in health.figures:
        if figure.name == "refused":
            yield Labels("refused", service), max(0.0, figure.value)


class Durations:
    """Counts durations, by service."""

    def __init__(self) -> None:
        self._counts: dict[str, list[int]] = {}
        self._sums_s: defaultdict[str, float] = defaultdict(float)

    def add(self, service: str, reported: Quantiles | None) -> None:
        """Count the durations of one report. None, or one that has no counts, adds nothing."""
        if reported is None or len(reported.counts) != len(BUCKETS):
            return
        counts = self._counts.get(service, [0] * len(BUCKETS))
        self._counts[service] = [sum(pair) for pair in zip(counts, reported.counts, strict=True)]
        self._sums_s[service] += max(0.0, reported.sum_s)  # a clock that was set back must not lower the sum

    def family(self, name: str, about: str) -> "HistogramMetricFamily":
        """Return the histogram under `name`, with its help."""
        from prometheus_client.metrics_core import HistogramMetricFamily  # noqa: PLC0415 - see SiteMetrics

        family = HistogramMetricFamily(name, about, labels=("service",))
        for service, counts in self._counts.items():
            totals = map(float, accumulate(counts))
            buckets = list(zip(BUCKETS, totals, strict=True))
            family.add_metric((service,), buckets, self._sums_s[service])
        return family


class SiteMetrics:
    """Metrics of one site: a collector of `prometheus_client`, 2 MB that the first scrape loads.

    Not thread-safe: messages and scrapes are in the same event loop.
    """

    def __init__(self, site: str, version: str, state: SiteState | None = None) -> None:
        """Begin without totals. `state`: its changes are given to `take`. None: one of its own, `state`."""
        self._about = {"site": site, "version": version}
        self.state = state or SiteState(self.take)
        self._totals = Totals()
        self._latency = Durations()
        self._step = Durations()
        self._selections: dict[str, int] = {}
        self._results: dict[tuple[str, str], int] = {}

    @property
    def is_empty(self) -> bool:
        """Return True if no service is present."""
        return not self.state.services

    def take(self, change: Change) -> None:
        """Count a message that has come."""
        match change.message:
            case Health() as health if change.name in self.state.services:
                service = _kind(change.name)
                self._totals.add(change.name, service, health)
                self._latency.add(service, health.latency)
                self._step.add(service, health.step)
            case Localization(phase=phase, purpose=purpose) if phase in RESULTS:
                previous = change.previous
                if isinstance(previous, Localization) and previous.phase not in RESULTS:
                    self._results[purpose, phase] = self._results.get((purpose, phase), 0) + 1
            case SelectionEvent(event=event):
                self._selections[event] = self._selections.get(event, 0) + 1
            case _:
                pass

    @property
    def _instances(self) -> list[str]:
        """Return the services that are present: those that are installed here, and as many others as fit."""
        services = sorted(self.state.services, key=lambda instance: (_kind(instance) == OTHER, instance))
        return services[:MAX_INSTANCES]

    @property
    def _health(self) -> dict[str, Health]:
        """Return the newest reports of services that are present, by instance."""
        reports = self.state.all(HEALTH)
        return {instance: reports[instance] for instance in sorted(self._instances) if instance in reports}

    def collect(self) -> Iterator["Metric"]:
        """Yield all families of metrics as they are now."""
        from prometheus_client.metrics_core import InfoMetricFamily  # noqa: PLC0415

        yield InfoMetricFamily("pointit_site", "Site, and version of PointIt", value=self._about)
        yield from self._of_services()
        yield from self._of_traffic()
        yield from self._of_people()

    def _of_services(self) -> Iterator["Metric"]:
        labels = ("service", "name")

        # Services that run or should run
        deployments = islice(self.state.all(DEPLOYMENT).items(), MAX_DEPLOYMENTS)
        expected = expected_services(dict(deployments))
        present = set(self._instances)
        presence: list[Row] = []
        for instance in sorted(present | expected.keys()):
            presence.append((split_instance(instance), float(instance in present)))
        yield _gauge(
            "pointit_service_present",
            "1: the service runs. 0: it should run, and does not",
            labels,
            presence,
        )

        # What those that run report of themselves
        reports = {split_instance(instance): health for instance, health in self._health.items()}
        yield _gauge(
            "pointit_service_healthy",
            "1: the service reports no problem. 0: it does",
            labels,
            ((instance, float(health.status == "ok")) for instance, health in reports.items()),
        )
        yield _gauge(
            "pointit_service_warnings",
            "Warnings of the service; pointit doctor shows them with their remedies",
            labels,
            ((instance, len(health.warnings)) for instance, health in reports.items()),
        )
        yield _gauge(
            "pointit_service_reported_timestamp_seconds",
            "Time of the newest report of the service, by its own clock",
            labels,
            ((instance, health.stamp_ns / NS_PER_S) for instance, health in reports.items()),
        )
        for figure, name, about in (
            ("viewers", "pointit_page_viewers", "Open pages"),
            ("sessions", "pointit_router_sessions", "Connections to a router of a secured site"),
        ):
            rows: list[Row] = []
            for instance, health in reports.items():
                rows.extend((instance, value) for value in _figures(health, figure))
            yield _gauge(name, about, labels, rows)

    def _of_traffic(self) -> Iterator["Metric"]:
        totals = self._totals.values
        for counter, name, about, labels in (
            ("messages", "pointit_messages", "Messages read and written", ("service", "topic", "direction")),
            (
                "discarded",
                "pointit_discarded_messages",
                "Messages not handled: dropped for newer ones, lost on the way, or invalid",
                ("service", "topic", "reason"),
            ),
            ("errors", "pointit_errors", "Handlers that raised an exception", ("service",)),
            ("refused", "pointit_router_refusals", "Attempts that a router has refused", ("service",)),
        ):
            rows: list[Row] = []
            for total_labels, total in totals.items():
                if total_labels.counter == counter:
                    rows.append((total_labels[1 : 1 + len(labels)], total))
            yield _counter(name, about, labels, rows)
        yield self._latency.family(
            "pointit_latency_seconds",
            "Time from capture to the output of the service. That of led-driver is from wrist to light",
        )
        yield self._step.family("pointit_step_seconds", "Time of each call of the service's handlers")

    def _of_people(self) -> Iterator["Metric"]:
        users = sorted(self.state.people)[:MAX_USERS]
        yield _gauge("pointit_people", "People on the site", (), [((), len(users))])

        # Each of them, as far as their pose and the charge of their wrist are known
        poses = self.state.all(POSE)
        covariances = [(user, poses[user].covariance) for user in users if user in poses]
        yield _gauge(
            "pointit_pose_position_sigma_meters",
            "1 sigma of the person's position on the floor, in its worse direction",
            ("user",),
            (((user,), position_sigma_m(covariance)) for user, covariance in covariances),
        )
        yield _gauge(
            "pointit_pose_yaw_sigma_radians",
            "1 sigma of the azimuth of the person's coordinates",
            ("user",),
            (((user,), yaw_sigma_rad(covariance)) for user, covariance in covariances),
        )
        yield _gauge(
            "pointit_battery_ratio", "Charge of the person's wrist, 0 to 1", ("user",), self._batteries(users)
        )

        # Totals of all people together
        yield _counter(
            "pointit_localizations",
            "Localizations that have ended",
            ("purpose", "result"),
            self._results.items(),
        )
        yield _counter(
            "pointit_selection_events",
            "What happened to objects: selected, deselected, refused, left, dispatched",
            ("result",),
            (((result,), count) for result, count in self._selections.items()),
        )

    def _batteries(self, users: Sequence[str]) -> Rows:
        """Yield the charge of each person's wrist, the lowest of several."""
        for instance, health in self._health.items():
            service, user = split_instance(instance)
            if service != "imu-bridge" or user not in users:
                continue
            charges: list[float] = []
            for name in BATTERIES:
                charges.extend(_figures(health, name))
            if charges:
                yield (user,), min(charges) / 100.0


def _gauge(name: str, about: str, labels: Sequence[str], rows: Rows) -> "GaugeMetricFamily":
    from prometheus_client.metrics_core import GaugeMetricFamily  # noqa: PLC0415

    family = GaugeMetricFamily(name, about, labels=labels)
    for values, value in rows:
        family.add_metric(values, value)
    return family


def _counter(name: str, about: str, labels: Sequence[str], rows: Rows) -> "CounterMetricFamily":
    from prometheus_client.metrics_core import CounterMetricFamily  # noqa: PLC0415

    family = CounterMetricFamily(name, about, labels=labels)
    for values, value in rows:
        family.add_metric(values, value)
    return family


def _kind(instance: str) -> str:
    service, _ = split_instance(instance)
    kind = ROUTER if service.startswith(f"{ROUTER}-") else service
    return kind if kind in KINDS else OTHER


def _figures(health: Health, name: str) -> list[float]:
    return [figure.value for figure in health.figures if figure.name == name]
