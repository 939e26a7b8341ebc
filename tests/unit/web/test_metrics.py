"""Metrics of a site, from examples of messages; totals over restarts."""

import importlib
import itertools
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from prometheus_client.registry import CollectorRegistry

from pointit.bridges.web import site_metrics as module
from pointit.bridges.web.server.metrics_server import TEXT, exposition
from pointit.bridges.web.site_metrics import OTHER, Labels, SiteMetrics, Totals
from pointit.runtime.bus.instrumented import DurationWindow
from pointit.schemas import (
    Deployment,
    ExpectedService,
    Figure,
    Health,
    KeyHealth,
    Localization,
    Message,
    Quantiles,
    SelectionEvent,
    UserPose,
)
from pointit.schemas.system import DURATION_BOUNDS_S
from pointit.schemas.topics import CURSOR, RAY, TOPICS
from tests.support import there

OPEN_METRICS = "application/openmetrics-text;version=1.0.0"
NS_PER_S = 1_000_000_000
TOPIC_OF = {topic.message: topic for topic in TOPICS}


def health(instance: str, seq: int = 1, **fields: object) -> Health:
    """Return report number `seq`, one each second."""
    usual: dict[str, object] = {"stamp_ns": seq * NS_PER_S, "uptime_s": float(seq), "pid": 1}
    service = instance.partition(".")[0]
    return Health.model_validate(usual | fields | {"service": service, "instance": instance, "seq": seq})


def key(topic: str, direction: str = "in", **fields: object) -> KeyHealth:
    return KeyHealth.model_validate({"key": topic, "direction": direction, "rate_hz": 0.0} | fields)


class TakenMetrics(SiteMetrics):
    """Metrics of a site that a test writes and scrapes."""

    def __init__(self) -> None:
        super().__init__("lab", "1.2.3")
        self._registry = CollectorRegistry(auto_describe=False)
        self._registry.register(self)

    def hear(self, name: str, message: Message) -> None:
        self.state.take(TOPIC_OF[type(message)], name, message, 0.0)

    def value(self, sample: str, /, **labels: str) -> float | None:
        return self._registry.get_sample_value(sample, labels)


@pytest.fixture
def metrics() -> TakenMetrics:
    return TakenMetrics()


def test_services_have_their_health_or_are_missing(metrics: TakenMetrics) -> None:
    services = (ExpectedService(service="pui"), ExpectedService(service="pointing", user="anna"))
    metrics.hear("run.x", Deployment(stamp_ns=1, name="scenario_4", services=services))
    assert metrics.value("pointit_service_present", service="pointing", name="anna") == 0

    report = health("pui", 7, status="degraded", warnings=("a", "b"))
    metrics.hear("pui", report)  # it is not present yet
    assert metrics.value("pointit_service_healthy", service="pui", name="") is None

    metrics.state.set_service("pui", present=True)
    metrics.hear("pui", report)
    assert metrics.value("pointit_service_present", service="pui", name="") == 1
    assert metrics.value("pointit_service_healthy", service="pui", name="") == 0
    assert metrics.value("pointit_service_warnings", service="pui", name="") == 2
    assert metrics.value("pointit_service_reported_timestamp_seconds", service="pui", name="") == 7

    metrics.hear("run.x", Deployment(stamp_ns=2, name="scenario_4"))
    metrics.state.set_service("pui", present=False)
    for name in ("present", "healthy"):
        assert metrics.value(f"pointit_service_{name}", service="pui", name="") is None


def test_message_totals_are_rates_times_the_time_between_reports(metrics: TakenMetrics) -> None:
    labels = {"service": "pui", "topic": RAY.key, "direction": "in"}
    metrics.state.set_service("pui", present=True)
    for seq, expected in ((1, 50.0), (2, 100.0), (4, 200.0)):  # the third report is lost
        metrics.hear("pui", health("pui", seq, keys=(key(RAY.key, rate_hz=50.0),)))
        assert metrics.value("pointit_messages_total", **labels) == expected


def test_discarded_messages_of_all_people_are_summed_by_reason(metrics: TakenMetrics) -> None:
    for user in ("anna", "ben"):
        metrics.state.set_service(f"pointing.{user}", present=True)
        metrics.hear(f"pointing.{user}", health(f"pointing.{user}", keys=(key(RAY.key, lost=2, dropped=3),)))
    of = {"service": "pointing", "topic": RAY.key}
    assert metrics.value("pointit_discarded_messages_total", **of, reason="lost") == 4
    assert metrics.value("pointit_discarded_messages_total", **of, reason="dropped") == 6
    assert metrics.value("pointit_discarded_messages_total", **of, reason="invalid") == 0


def durations(*values_s: float) -> Quantiles:
    window = DurationWindow()
    for value_s in values_s:
        window.values.append(value_s)
    return there(window.take())


def test_durations_of_a_kind_of_service_are_one_histogram(metrics: TakenMetrics) -> None:
    for user, values_s in (("anna", (0.004, 0.05, 9.0)), ("ben", (0.03,)), ("anna", (0.0501,))):
        metrics.state.set_service(f"pointing.{user}", present=True)
        metrics.hear(f"pointing.{user}", health(f"pointing.{user}", latency=durations(*values_s)))
    uncounted = (Quantiles(p50_s=0.001, p99_s=0.002, counts=counts) for counts in ((), (1, 2)))
    for seq, latency in enumerate((None, *uncounted), 2):  # nothing was measured, or in other buckets
        metrics.hear("pointing.ben", health("pointing.ben", seq, latency=latency))
    buckets = {
        bound: metrics.value("pointit_latency_seconds_bucket", service="pointing", le=str(bound))
        for bound in DURATION_BOUNDS_S
    }

    assert [buckets[bound] for bound in (0.002, 0.005, 0.02, 0.05, 0.1, 5.0)] == [0, 1, 1, 3, 4, 4]
    assert metrics.value("pointit_latency_seconds_bucket", service="pointing", le="+Inf") == 5
    assert metrics.value("pointit_latency_seconds_count", service="pointing") == 5
    assert metrics.value("pointit_latency_seconds_sum", service="pointing") == pytest.approx(9.1341)
    assert metrics.value("pointit_step_seconds_count", service="pointing") is None


def test_sum_of_durations_never_falls_when_a_clock_goes_back(metrics: TakenMetrics) -> None:
    metrics.state.set_service("pui", present=True)
    for values_s, count, sum_s in (((0.5,), 1, 0.5), ((-3.0,), 2, 0.5), ((0.25,), 3, 0.75)):
        metrics.hear("pui", health("pui", latency=durations(*values_s)))
        assert metrics.value("pointit_latency_seconds_count", service="pui") == count
        assert metrics.value("pointit_latency_seconds_sum", service="pui") == pytest.approx(sum_s)


def test_pose_sigmas_come_from_the_covariance(metrics: TakenMetrics) -> None:
    # 0.3 m along the diagonal of the floor, 0.1 m across, 0.05 rad
    along = 0.3**2
    across = 0.1**2
    xx = (along + across) / 2.0
    xy = (along - across) / 2.0
    covariance = (xx, xy, 0.0, xy, xx, 0.0, 0.0, 0.0, 0.05**2)
    metrics.hear("anna", UserPose(stamp_ns=1, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0, covariance=covariance))
    assert metrics.value("pointit_pose_yaw_sigma_radians", user="anna") is None  # she is not there yet
    metrics.state.set_person("anna", present=True)
    assert metrics.value("pointit_people") == 1
    assert metrics.value("pointit_pose_position_sigma_meters", user="anna") == pytest.approx(0.3)
    assert metrics.value("pointit_pose_yaw_sigma_radians", user="anna") == pytest.approx(0.05)
    metrics.state.set_person("anna", present=False)
    assert metrics.value("pointit_pose_position_sigma_meters", user="anna") is None


def test_localization_counts_once_when_it_ends(metrics: TakenMetrics) -> None:
    for phase in ("solved", "sampling", "refused", "refused", "sampling", "solved"):
        metrics.hear("anna", Localization.model_validate({"stamp_ns": 1, "phase": phase}))
    assert metrics.value("pointit_localizations_total", purpose="pose", result="refused") == 1
    assert metrics.value("pointit_localizations_total", purpose="pose", result="solved") == 1


def test_selections_batteries_viewers_and_refusals_are_shown(metrics: TakenMetrics) -> None:
    for _ in range(2):
        metrics.hear("", SelectionEvent(stamp_ns=1, event="selected", object_id="a", user="anna"))
    metrics.state.set_person("anna", present=True)
    for instance, name, value in (
        ("imu-bridge.anna", "battery", 25.0),
        ("web", "viewers", 3.0),
        ("router", "refused", 7.0),
        ("router-hall", "refused", 2.0),  # of another machine
    ):
        metrics.state.set_service(instance, present=True)
        metrics.hear(instance, health(instance, figures=(Figure(name=name, value=value),)))

    assert metrics.value("pointit_selection_events_total", result="selected") == 2
    assert metrics.value("pointit_battery_ratio", user="anna") == 0.25
    assert metrics.value("pointit_page_viewers", service="web", name="") == 3
    assert metrics.value("pointit_router_refusals_total", service="router") == 9


def test_number_of_series_is_bounded_when_names_are_invented(
    metrics: TakenMetrics, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MAX_INSTANCES", 10)
    monkeypatch.setattr(module, "MAX_USERS", 10)
    latency = durations(0.001, 0.002)
    for number in range(100):
        instance = f"made-up-{number}"
        user = f"u{number}"
        metrics.state.set_service(instance, present=True)
        metrics.state.set_person(user, present=True)
        metrics.hear(instance, health(instance, keys=(key(f"made/up/{number}", lost=1),), latency=latency))
        metrics.hear(user, UserPose(stamp_ns=1, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0))
    families = {family.name: family for family in metrics.collect()}

    assert len(families["pointit_service_present"].samples) == 10
    assert len(families["pointit_pose_yaw_sigma_radians"].samples) == 10
    assert {sample.labels["topic"] for sample in families["pointit_messages"].samples} == {OTHER}
    for name in ("errors", "messages", "discarded_messages", "latency_seconds"):
        assert {sample.labels["service"] for sample in families[f"pointit_{name}"].samples} == {OTHER}, name


def test_people_who_left_have_no_series(metrics: TakenMetrics, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_USERS", 3)
    pose = UserPose(stamp_ns=1, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0)
    solving, solved = (
        Localization.model_validate({"stamp_ns": 1, "phase": phase}) for phase in ("sampling", "solved")
    )

    def arrive(user: str) -> None:
        for message in (pose, solving, solved):
            metrics.hear(user, message)

    metrics.state.set_person("anna", present=True)
    arrive("anna")
    for number in range(10):  # messages of people whose presence has ended
        arrive(f"u{number}")
    arrive("ben")  # a pose may come before the presence
    metrics.state.set_person("ben", present=True)
    for user in ("anna", "ben"):
        assert metrics.value("pointit_pose_yaw_sigma_radians", user=user) == 0.0
    arrive("anna")
    assert metrics.value("pointit_localizations_total", purpose="pose", result="solved") == 13


def test_exposition_is_read_by_parsers_of_both_formats(metrics: TakenMetrics) -> None:
    metrics.state.set_service("pui", present=True)
    quantiles = durations(0.001, 0.002)
    metrics.hear("pui", health("pui", keys=(key(CURSOR.key, "out", rate_hz=50.0),), latency=quantiles))
    content, media_type = exposition(metrics, OPEN_METRICS)
    assert media_type.startswith("application/openmetrics-text")

    parser: Any = importlib.import_module("prometheus_client.openmetrics.parser")  # untyped
    families = {family.name: family for family in parser.text_string_to_metric_families(content.decode())}
    (site,) = families["pointit_site"].samples
    assert site.labels == {"site": "lab", "version": "1.2.3"}
    assert families["pointit_messages"].samples[0].value == 50

    latency = {sample.name: sample.value for sample in families["pointit_latency_seconds"].samples}
    assert families["pointit_latency_seconds"].type == "histogram"
    assert latency["pointit_latency_seconds_count"] == 2

    plain, media_type = exposition(metrics, "")
    assert media_type.startswith(TEXT)
    assert b"# TYPE pointit_messages_total counter" in plain


def test_totals_exclude_counts_from_before_the_first_report() -> None:
    totals = Totals()
    errors = Labels("errors", "pui")
    lost = Labels("discarded", "pui", RAY.key, "lost")
    refused = Labels("refused", "pui")

    now_ns = itertools.count(1, NS_PER_S)

    def hear(instance: str, seq: int, count: int) -> list[float]:
        figures = (Figure(name="refused", value=float(count)),)
        fields = {"errors": count, "keys": (key(RAY.key, lost=count),), "figures": figures}
        fields["stamp_ns"] = next(now_ns)
        totals.add(instance, "pui", health(instance, seq, **fields))
        return [totals.values[labels] for labels in (errors, lost, refused)]

    assert hear("pui", 100, 500) == [0, 0, 0]
    assert hear("pui", 101, 502) == [2, 2, 2]
    assert hear("pui.hall", 70, 300) == [2, 2, 2]  # a second instance
    assert hear("pui.hall", 71, 301) == [3, 3, 3]
    assert hear("pui.lab", 1, 4) == [7, 7, 7]  # it has only just started
    assert hear("pui", 3, 1) == [8, 8, 8]  # started again


reports = st.lists(
    st.tuples(st.booleans(), st.integers(0, 20)),  # whether it has restarted before, and what it lost since
    min_size=1,
    max_size=30,
)


@given(reports, st.sets(st.integers(0, 29)))
def test_totals_never_fall_and_are_exact_without_loss(
    steps: list[tuple[bool, int]], unheard: set[int]
) -> None:
    heard_all = Totals()
    heard_some = Totals()
    labels = Labels("discarded", "pui", RAY.key, "lost")
    uptime = 0
    lost = 0
    before = 0.0
    for number, (is_restarted, more) in enumerate(steps):
        uptime, lost = (1, more) if is_restarted else (uptime + 1, lost + more)
        report = health(
            "pui", uptime, stamp_ns=(number + 1) * NS_PER_S, keys=(key(RAY.key, lost=lost, rate_hz=1.0),)
        )
        heard_all.add("pui", "pui", report)
        if number not in unheard:
            heard_some.add("pui", "pui", report)
        assert heard_some.values[labels] >= before
        before = heard_some.values[labels]

    assert heard_all.values[labels] == sum(more for _, more in steps)
    assert heard_some.values[labels] <= heard_all.values[labels]
    messages = heard_all.values[Labels("messages", "pui", RAY.key, "in")]
    assert math.isclose(messages, len(steps))


def test_late_report_adds_nothing() -> None:
    totals = Totals()
    labels = Labels("errors", "pui")
    for seq in (1, 3, 2, 4):
        totals.add("pui", "pui", health("pui", seq, errors=seq))
    assert totals.values[labels] == 4


def test_total_never_falls_when_a_router_counts_backwards() -> None:
    totals = Totals()
    for seq, value, total in ((1, 5.0, 5.0), (2, -100.0, 5.0), (3, 1.0, 6.0)):
        totals.add("router", "router", health("router", seq, figures=(Figure(name="refused", value=value),)))
        assert totals.values[Labels("refused", "router")] == total
