"""Topics, requests and services: tables as they are, typed keys and values."""

import io
import json
import math
import statistics
from typing import Any

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from pointit.cli.common.lazy import UnknownNameError
from pointit.cli.common.output import print_table
from pointit.cli.inspect.call import build_query, requests
from pointit.cli.inspect.topics import RateMeter, TopicCounter, Wanted, resolve, resolve_all, show_rates
from pointit.cli.inspect.track import TrackerMeters, Tracking, show
from pointit.cli.main import command
from pointit.schemas import (
    NS_PER_S,
    Configuration,
    Health,
    ImuSample,
    TrackedObject,
    TrackedObjects,
    UserPose,
    topics,
)
from pointit.schemas.system import Figure
from pointit.services.registry import PROCESSES
from tests.support.bench import memory_bench


def invoke(*arguments: str) -> str:
    result = CliRunner().invoke(command, list(arguments))
    assert result.exit_code == 0, result.output
    return result.stdout


def records(*arguments: str) -> dict[str, list[dict[str, Any]]]:
    parsed: dict[str, list[dict[str, Any]]] = json.loads(invoke(*arguments, "--json"))
    return parsed


def test_topics_shows_every_row_on_one_line() -> None:
    lines = invoke("topic", "list").splitlines()
    for topic in topics.TOPICS:
        (line,) = (line for line in lines if line.split()[:1] == [topic.key])
        assert topic.message.schema_name() in line
        assert f" {topic.delivery.value} " in line
        assert ", ".join(topic.writers) in line
        assert topic.about in line
        assert topic.rate_hz is None or f" {topic.rate_hz:g} " in line


def test_topics_as_json() -> None:
    tables = records("topic", "list")
    assert list(tables) == ["topics", "requests", "presence"]
    assert [row["key"] for row in tables["topics"]] == [topic.key for topic in topics.TOPICS]
    assert tables["topics"][0] == {
        "key": topics.TOPICS[0].key,
        "message": f"ImuSample.v{ImuSample.version}",
        "delivery": "latest",
        "rate_hz": 50,
        "writers": list(topics.TOPICS[0].writers),
        "about": topics.TOPICS[0].about,
    }
    assert [row["key"] for row in tables["requests"]] == [request.key for request in topics.REQUESTS]
    assert [row["server"] for row in tables["requests"]] == [request.server for request in topics.REQUESTS]
    assert [row["key"] for row in tables["presence"]] == [presence.key for presence in topics.PRESENCES]


def test_list_shows_what_each_service_reads_writes_and_serves() -> None:
    rows = {row["name"]: row for row in records("list", "services")["services"]}
    assert list(rows) == [row.name for row in PROCESSES]
    for row in PROCESSES:
        shown = rows[row.name]
        assert (shown["scope"], shown["about"], shown["extra"]) == (row.scope, row.about, row.extra)
        assert shown["reads"] == [topic.key for topic in row.reads]
        assert shown["writes"] == [topic.key for topic in row.writes]
        assert shown["serves"] == [request.key for request in row.serves]
    assert {"web", "foxglove"} <= rows.keys()  # bridges are processes too
    text = invoke("list")
    assert all(row.about in text for row in PROCESSES)


@pytest.mark.parametrize("noun", ["service", "map", "plugin"])
def test_a_noun_lists_what_list_shows_of_it(noun: str) -> None:
    assert records(noun, "list") == records("list", f"{noun}s")


@pytest.mark.parametrize("width", ["40", "200"])
def test_a_narrow_terminal_loses_no_text(monkeypatch: pytest.MonkeyPatch, width: str) -> None:
    monkeypatch.setenv("COLUMNS", width)
    text = invoke("topic", "list")
    assert "…" not in text


@pytest.mark.parametrize(
    ("typed", "wanted"),
    [
        ("/users/anna/imu/", [(topics.IMU, "anna")]),
        ("users/*/cursor", [(topics.CURSOR, "*")]),
        ("users/{user}/cursor", [(topics.CURSOR, "*")]),
        ("*", [(topics.MAP, ""), (topics.SELECTION, "")]),
        ("objects/*", [(topics.OBJECTS, "*")]),
        (
            "selection/**",
            [
                (topics.SELECTION, ""),
                (topics.MANNER, ""),
                (topics.SELECTION_EVENTS, ""),
                (topics.OUTCOMES, ""),
            ],
        ),
    ],
)
def test_keys_stand_for_rows_and_names(typed: str, wanted: list[Wanted]) -> None:
    assert [pair for pair in resolve(typed) if pair[0].key != "clock"] == wanted


def test_everything_is_every_row() -> None:
    assert [topic for topic, _ in resolve("**")] == list(topics.TOPICS)


def test_doubles_count_once() -> None:
    assert resolve_all(["map", "users/*/imu", "map"]) == [(topics.MAP, ""), (topics.IMU, "*")]


@given(st.sampled_from(topics.TOPICS), st.from_regex(r"[A-Za-z0-9_][A-Za-z0-9_.\-]{0,20}", fullmatch=True))
def test_every_key_of_the_table_is_found_by_itself(topic: object, name: str) -> None:
    row = next(other for other in topics.TOPICS if other is topic)
    wanted = name if row.placeholder else ""
    assert resolve(row.at(wanted)) == [(row, wanted)]


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("users/anna/imuu", "did you mean users/anna/imu"),
        ("user/anna/cursor", "users/anna/cursor"),
        ("mapp", "did you mean map"),
        ("zzzzzzzz", "`pointit topic list` shows them all"),
        ("conveyor/reset", "is something to ask for"),
        ("alive/users/anna", "is presence"),
        ("users/a b/imu", "use 1 to 64 letters"),
        ("", "no topic has the key ''"),
    ],
)
def test_unknown_keys_get_one_sentence(typed: str, said: str) -> None:
    with pytest.raises(UnknownNameError) as caught:
        resolve(typed)
    assert said in caught.value.message
    assert "\n" not in caught.value.message
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    ("request_row", "typed", "value"),
    [
        (topics.SET_SPEED, "belts=part_e,part_f", ("part_e", "part_f")),
        (topics.SET_SPEED, "belts=[part_e, part_f]", ("part_e", "part_f")),
        (topics.SET_SPEED, "belts=['part_e', part_f]", ("part_e", "part_f")),
        (topics.SET_SPEED, "belts=part_e", ("part_e",)),
        (topics.SET_POSE, "position_m=1, 2,0", (1.0, 2.0, 0.0)),
        (topics.SET_FEEDING, "feeding=off", False),
        (topics.SET_FEEDING, "feeding=on", True),
    ],
)
def test_lists_need_no_brackets_and_switches_accept_on_and_off(
    request_row: topics.Request[Any, Any], typed: str, value: object
) -> None:
    others = ["speed_mps=0.2"] if request_row is topics.SET_SPEED else []
    assert (
        getattr(build_query(request_row, request_row.key, [*others, typed]), typed.partition("=")[0]) == value
    )


def test_no_key_or_field_is_broken_at_eighty_columns() -> None:
    text = io.StringIO()
    print_table(Console(file=text, width=80), requests())
    lines = text.getvalue().splitlines()
    for row in requests().rows:
        assert any(f" {row['key']} " in line and f" {row['field']}" in line for line in lines), row


def test_one_message_has_no_rate() -> None:
    meter = RateMeter("map")
    meter.add(1.0, 10)
    rate = meter.take(6.0, 5.0)
    assert (rate.messages, rate.rate_hz, rate.period_max_s, rate.jitter_s) == (1, None, None, None)
    assert meter.take(11.0, 5.0).messages == 0


def test_a_stream_that_stops_shows_its_silence() -> None:
    meter = RateMeter("objects")
    for k in range(10):
        meter.add(k * 0.1, 1)
    assert meter.take(5.0, 5.0).period_max_s == pytest.approx(4.1)


def test_the_period_across_two_windows_counts_in_the_second() -> None:
    meter = RateMeter("objects")
    for time_s in (0.0, 1.0):
        meter.add(time_s, 1)
    meter.take(1.5, 1.5)
    meter.add(3.0, 1)
    rate = meter.take(3.0, 1.5)
    assert rate.messages == 1
    assert rate.period_max_s == pytest.approx(2.0)


@given(st.lists(st.floats(1e-3, 10), min_size=1, max_size=50))
def test_the_account_is_that_of_all_periods(periods_s: list[float]) -> None:
    meter = RateMeter("objects", 25)
    now_s = 1e3
    meter.add(now_s, 30)
    for period_s in periods_s:
        now_s += period_s
        meter.add(now_s, 30)
    rate = meter.take(now_s, 2.0)
    messages = len(periods_s) + 1

    assert (rate.key, rate.nominal_hz, rate.messages) == ("objects", 25, messages)
    assert rate.bytes_per_s == pytest.approx(messages * 30 / 2.0)
    assert rate.period_min_s == pytest.approx(min(periods_s))
    assert rate.period_max_s == pytest.approx(max(periods_s))
    assert rate.rate_hz is not None
    assert rate.jitter_s is not None
    assert math.isclose(rate.rate_hz, len(periods_s) / sum(periods_s), rel_tol=1e-6)
    assert math.isclose(rate.jitter_s, statistics.pstdev(periods_s), rel_tol=1e-6, abs_tol=1e-6)


BEGIN_NS = 1000 * NS_PER_S


def thing(name: str, **fields: object) -> TrackedObject:
    return TrackedObject.model_validate({"id": name, "kind": "red", "position_m": (1.0, 2.0, 0.5), **fields})


def measured(*only: str) -> Tracking:
    meters = TrackerMeters(only)
    cups = (thing("mug", velocity_mps=(3.0, 4.0, 0.0), yaw_rad=0.0), thing("cup", position_sigma_m=0.02))
    for step in range(30):
        late_ns = NS_PER_S // 10 if step % 10 else NS_PER_S // 2
        now_ns = BEGIN_NS + step * NS_PER_S // 10
        camera = TrackedObjects(stamp_ns=now_ns - late_ns, objects=cups, latency_sigma_s=0.03)
        meters.add("camera", camera, arrived_s=0.1 * step, arrived_ns=now_ns)
        other = TrackedObjects(stamp_ns=now_ns, objects=(thing("cup"),))
        meters.add("robot", other, arrived_s=0.1 * step, arrived_ns=now_ns)
    return meters.take(3.0, 3.0)


def test_rates_ages_and_objects_are_measured() -> None:
    tracking = measured()
    camera, robot = tracking.trackers
    assert (camera.tracker, camera.objects, camera.latency_sigma_s) == ("camera", 2, 0.03)
    assert (camera.rate_hz, camera.age_s) == pytest.approx((10.0, 0.1))
    assert camera.age_p95_s == pytest.approx(0.5)
    assert robot.age_s == pytest.approx(0.0)
    cup, mug, _ = tracking.objects
    assert (cup.object, cup.tracker, cup.sigma_m, cup.yaw_deg) == ("cup", "camera", 0.02, None)
    assert (mug.x_m, mug.y_m, mug.z_m, mug.speed_mps, mug.yaw_deg) == (1.0, 2.0, 0.5, 5.0, 0.0)


def test_one_object_of_two_trackers_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert show(measured("robot"), 3.0, as_json=False)
    out = capsys.readouterr().out
    assert "warning: the trackers camera and robot both report cup" in out
    assert "mug" not in out.replace("cup of the tracker camera and mug", "")


def test_a_window_is_one_line_of_json(capsys: pytest.CaptureFixture[str]) -> None:
    show(measured(), 3.0, as_json=True)
    (line,) = capsys.readouterr().out.splitlines()
    said = json.loads(line)
    assert said["window_s"] == 3.0
    assert [row["tracker"] for row in said["trackers"]] == ["camera", "robot"]
    assert [row["object"] for row in said["objects"]] == ["cup", "mug", "cup"]
    assert said["twins"][0].startswith("the trackers camera and robot both report cup")


def test_localized_people_are_compared_with_their_true_poses(capsys: pytest.CaptureFixture[str]) -> None:
    meters = TrackerMeters()
    seen = [("anna", "person_frame"), ("ben", "person"), ("cleo", "person_frame"), ("cup", "red")]
    objects = tuple(thing(name, kind=kind, yaw_rad=math.radians(178.0)) for name, kind in seen)
    tracked = TrackedObjects(stamp_ns=BEGIN_NS, objects=objects)
    meters.add("mocap", tracked, arrived_s=0.0, arrived_ns=BEGIN_NS)
    for name in ("anna", "ben", "cup"):
        pose = UserPose(
            stamp_ns=BEGIN_NS - 60 * NS_PER_S, position_m=(1.3, 2.4, 0.0), yaw_rad=math.radians(-179.0),
            method="static_targets",
        )  # fmt: skip
        meters.add_pose(name, pose)
    tracking = meters.take(3.0, 3.0)
    anna, ben, cleo = tracking.truth

    assert [row.person for row in tracking.truth] == ["anna", "ben", "cleo"]
    assert (anna.position_error_m, ben.position_error_m) == pytest.approx((0.5, 0.5))
    assert (anna.yaw_error_deg, anna.true_yaw_deg) == pytest.approx((3.0, 178.0))
    assert ben.yaw_error_deg is None
    assert (cleo.position_error_m, cleo.yaw_error_deg) == (None, None)
    assert show(tracking, 3.0, as_json=False)
    assert "localized pose less the true one" in capsys.readouterr().out

    show(tracking, 3.0, as_json=True)
    assert [row["person"] for row in json.loads(capsys.readouterr().out)["truth"]] == ["anna", "ben", "cleo"]
    assert meters.take(6.0, 3.0).truth == (), "the tracker is silent: nothing is known to be true"


@pytest.mark.parametrize("key", ["objects/*", "users/anna/pose"])
async def test_rates_of_objects_or_poses_come_with_pose_errors(
    key: str, capsys: pytest.CaptureFixture[str]
) -> None:
    async with memory_bench() as bench:
        counter = TopicCounter(bench.bus, resolve_all([key]), [])
        bench.put(topics.OBJECTS, TrackedObjects(stamp_ns=BEGIN_NS, objects=(thing("cup"),)), "robot")
        heads = tuple(thing(each, kind="person_frame", yaw_rad=0.1) for each in ("anna", "ben"))
        bench.put(topics.OBJECTS, TrackedObjects(stamp_ns=BEGIN_NS, objects=heads), "mocap")
        pose = UserPose(stamp_ns=BEGIN_NS, position_m=(1.0, 2.3, 0.0), yaw_rad=0.2, method="static_targets")
        bench.put(topics.POSE, pose, "anna")
        bench.put(topics.POSE, pose, "ben")
        await bench.settle()
        rates = counter.take(1.0, 1.0)
        truth = counter.pose_errors.take()
    assert {rate.key for rate in rates} == (
        {"objects/mocap", "objects/robot"} if "obj" in key else {"users/anna/pose"}
    )
    assert [row.person for row in truth] == ["anna", "ben"]
    for row in truth:  # also of people whose poses were not asked for
        assert (row.position_error_m, row.yaw_error_deg) == pytest.approx((0.3, math.degrees(0.1)))
    assert counter.pose_errors.take() == (), "nothing came since: nothing is known to be true"

    show_rates(rates, 1.0, 0, truth, as_json=False)
    assert "localized pose less the true one" in capsys.readouterr().out
    show_rates(rates, 1.0, 0, truth, as_json=True)
    shown = json.loads(capsys.readouterr().out)["truth"][0]
    assert shown["position_error_m"] == pytest.approx(0.3)


def test_bodies_of_motion_capture_are_listed_beside_the_configured_ones(
    capsys: pytest.CaptureFixture[str],
) -> None:
    meters = TrackerMeters()
    figures = {"body Kappe": 1.0, "body cup": 0.0, "frame rate": 120.0}
    health = Health(
        stamp_ns=BEGIN_NS, service="mocap", instance="mocap", pid=1,
        figures=tuple(Figure(name=name, value=value) for name, value in figures.items()),
    )  # fmt: skip
    parameters = '{"server": "motive", "bodies": {"cap": {"person": "anna"}, "cup": {"kind": "red"}}}'
    for text in (parameters, "not JSON"):
        configuration = Configuration(stamp_ns=BEGIN_NS, service="mocap", instance="mocap", parameters=text)
        meters.add_configuration(configuration, "mocap")

    meters.add_health(health, "mocap")
    assert show(meters.take(3.0, 3.0), 3.0, as_json=False)
    lines = capsys.readouterr().out.splitlines()
    assert [" ".join(line.split()) for line in lines if "mocap" in line] == [
        "Kappe mocap - used",
        "cap mocap head of anna not in the stream",
        "cup mocap red not used",
    ]  # fmt: skip


def test_without_a_tracker_the_remedy_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    show(TrackerMeters().take(3.0, 3.0), 3.0, as_json=False)
    assert capsys.readouterr().err == (
        "no tracker sent a message within 3 s; start one, or see `pointit doctor`\n"
    )
