"""The log of ROS: what goes wrong is said once, and when it is over; what flaps does not flood."""

import itertools
from typing import Any

import pytest

from pointit.bridges.ros2.graph.backend import ROSOUT
from pointit.bridges.ros2.outbound.rosout import (
    ERROR,
    INFO,
    MAX_AT_ONCE,
    MAX_REPORTS,
    OVER_REPORTS,
    REPORTS_PER_LINE,
    WARN,
)
from pointit.bridges.ros2.outbound.values import MAX_TEXT
from pointit.bridges.ros2.routing.route_types import OutboundRoute
from pointit.bridges.ros2.routing.routes import routes
from pointit.schemas import NS_PER_S, Health
from pointit.schemas.problems import LATE, Problem
from pointit.schemas.topics import HEALTH
from tests.support.bench import START_NS, until
from tests.unit.ros2.graph_of_one import Bench
from tests.unit.ros2.scenes import NOW_NS, furnished, jazzy, out, sent

ROS = "/rosout"
TYPE = "rcl_interfaces/msg/Log"
NO_MAP = "no map: start pui"
QUOTED = f"says: “{NO_MAP}”"
"""The same from a person's service: its words are quoted."""
NO_WRIST = "no wrist: charge it"
Said = tuple[int, str]


def health(*warnings: str, instance: str = "pui", **fields: Any) -> Health:
    values: dict[str, Any] = {"stamp_ns": NOW_NS, "pid": 1, "host": "site", "warnings": warnings} | fields
    return Health(status="degraded" if warnings else "ok", service=instance, instance=instance, **values)


class Log:
    """The route, and what it has said of whom."""

    def __init__(self) -> None:
        self.row: OutboundRoute = out(routes(), "rosout")
        self.scene = furnished()

    def lines(self, report: Health) -> list[Any]:
        return sent(self.row, report, self.scene, report.instance)

    def says(self, report: Health, times: int = 1) -> list[Said]:
        """Return the lines from this many copies of the same report in a row."""
        values = [value for _ in range(times) for value in self.lines(report)]
        assert {value.name for value in values} <= {f"pointit.{report.instance}"}
        return [(value.level, value.msg) for value in values]

    def end(self, instance: str) -> None:
        assert self.row.forgets is not None
        self.row.forgets(instance)

    def begin(self) -> None:
        assert self.row.begins is not None
        self.row.begins()


@pytest.fixture
def log() -> Log:
    return Log()


def test_log_line_matches_a_genuine_nodes_with_stamp_and_name(log: Log) -> None:
    assert (log.row.ros, log.row.type, log.row.qos, log.row.enabled) == (ROS, TYPE, ROSOUT, True)
    assert jazzy().kind(TYPE).hash.startswith("RIHS01_e28ce254"), "what the captured node has in its token"
    made = jazzy().make(TYPE)
    assert (INFO, WARN, ERROR) == (made.INFO, made.WARN, made.ERROR)
    (line,) = log.lines(health(NO_MAP, instance="pointing.anna", stamp_ns=7 * NS_PER_S + 5))
    assert (line.stamp.sec, line.stamp.nanosec) == (7, 5)
    assert (line.level, line.name, line.msg) == (WARN, "pointit.pointing.anna", QUOTED)
    assert (line.file, line.function, line.line) == ("", "", 0)


def test_finding_is_logged_at_its_start_and_end(log: Log) -> None:
    assert log.says(health(), 3) == []
    assert log.says(health(NO_MAP), 100) == [(WARN, NO_MAP)]
    assert log.says(health(), OVER_REPORTS - 1) == []
    assert log.says(health()) == [(INFO, f"over: {NO_MAP}")]
    assert log.says(health(), 100) == []
    assert log.says(health(NO_MAP)) == [(WARN, NO_MAP)], "it is new again"


def test_further_and_reworded_findings_are_logged(log: Log) -> None:
    late = "no IMU: is it charged?"
    log.says(health(NO_MAP))
    assert log.says(health(NO_MAP, late), 2) == [(WARN, late)]
    assert log.says(health("no map: pui has ended", late)) == [(WARN, "no map: pui has ended")]
    assert log.says(health("no map: pui has ended", late), OVER_REPORTS) == [(INFO, f"over: {NO_MAP}")]


def test_growing_counts_are_not_new_findings(log: Log) -> None:
    def lost(count: int) -> str:
        return f"{count} messages of user1 came {count / 10} s late: look at the link"

    def report(count: int, user: str = "user1") -> Health:
        return health(problems=(Problem(code=LATE, sentence=lost(count), subject=user),))

    assert log.says(report(1)) == [(WARN, lost(1))]
    assert [log.says(report(count)) for count in range(2, 50)] == [[]] * 48
    assert log.says(report(50, "user2")) == [(WARN, lost(50))], "another subject is another problem"
    assert log.says(health(), OVER_REPORTS) == [(INFO, f"over: {lost(49)}"), (INFO, f"over: {lost(50)}")]


def test_failing_calls_are_one_error_in_each_process(log: Log) -> None:
    assert log.says(health(errors=3)) == [], "before we looked"
    ((level, said),) = log.says(health(errors=4))
    assert level == ERROR
    assert said.startswith("4 of its handlers' calls failed; the number is growing; its log has")
    assert log.says(health(errors=5)) == []
    ((level, said),) = log.says(health(errors=5), OVER_REPORTS)
    assert (level, said.split(" ")[:3]) == (INFO, ["over:", "5", "of"])
    assert log.says(health(errors=9, pid=2)) == []


def test_flapping_finding_is_logged_once_and_blocks_no_other(log: Log) -> None:
    said = [log.says(health(*((NO_MAP,) if count % OVER_REPORTS else ()))) for count in range(500)]
    assert [line for lines in said for line in lines] == [(WARN, NO_MAP)]
    log.says(health(*(f"{chr(ord('a') + count)} is gone" for count in range(26))), 9)
    assert log.says(health(NO_MAP, instance="led-driver")) == [(WARN, NO_MAP)]


def test_slow_or_changing_findings_do_not_flood_the_log(log: Log) -> None:
    reports = 1000
    most = MAX_AT_ONCE + reports // REPORTS_PER_LINE
    slowly = itertools.cycle([True] * OVER_REPORTS + [False] * OVER_REPORTS)
    told = sum(
        len(log.says(health(*(f"{name} is gone" for name in "abcd" if on), instance="one")))
        for on in itertools.islice(slowly, reports)
    )
    assert most // 2 < told <= most
    words = (chr(ord("a") + count % 26) * (count // 26 + 1) for count in range(reports))
    told = sum(len(log.says(health(f"{word} is odd", instance="two"))) for word in words)
    assert most // 2 < told <= most


@pytest.mark.slow
def test_many_findings_are_logged_in_portions_and_bounded(log: Log) -> None:
    report = health(*(f"{chr(ord('a') + count)} is gone" for count in range(MAX_AT_ONCE + 4)))
    assert len(log.says(report)) == MAX_AT_ONCE
    assert len(log.says(report, 4 * REPORTS_PER_LINE)) == 4
    assert log.says(report, 100) == []
    words = [f"{''.join(pair)} is gone" for pair in itertools.product("abcdefghij", repeat=2)]
    assert len(words) > MAX_REPORTS
    report = health(*words, instance="bounded")
    assert len(log.says(report, MAX_REPORTS * REPORTS_PER_LINE * 2)) == MAX_REPORTS
    assert len(log.says(health(words[0], instance="bounded"), OVER_REPORTS + 10)) > 0, "and goes on"


def test_restarted_service_logs_findings_again_within_the_same_limit(log: Log) -> None:
    log.says(health(NO_MAP))
    log.end("pui")
    assert log.says(health()) == [], "nothing to be over"
    lives = 200
    told = 0
    for _ in range(lives):
        told += len(log.says(health(NO_MAP, instance="crash"), 2))
        log.end("crash")
    assert 0 < told <= MAX_AT_ONCE + 2 * lives // REPORTS_PER_LINE


def test_first_reader_gets_current_findings_only(log: Log) -> None:
    log.says(health(NO_MAP, NO_WRIST))
    log.begin()
    assert log.says(health(NO_MAP), 2 * OVER_REPORTS) == [(WARN, NO_MAP)]


def test_no_text_is_longer_than_ros_needs(log: Log) -> None:
    ((_, said),) = log.says(health("w\0" * 5000, instance="pui"))
    assert said.startswith("w?w?")
    assert "\0" not in said
    assert len(said) <= MAX_TEXT
    assert log.says(health("w\0" * 5000), 9) == []


async def test_ended_service_is_forgotten_but_not_a_leaving_person(eager: Bench) -> None:
    topic: Any = HEALTH

    def reports(instance: str = "pui") -> None:
        eager.outbox.take(topic, health(NO_MAP, instance=instance, stamp_ns=START_NS), instance)

    def heard() -> list[str]:
        return [each.name for each in eager.heard(ROS, TYPE)]

    reports()
    await until(lambda: heard() == ["pointit.pui"])
    eager.outbox.leave("pui")
    reports()
    reports("keeper")
    await until(lambda: heard() == ["pointit.pui", "pointit.keeper"], what="the reports to be read")
    eager.outbox.end("pui")
    reports()
    await until(lambda: heard() == ["pointit.pui", "pointit.keeper", "pointit.pui"])
