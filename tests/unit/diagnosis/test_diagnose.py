"""Things that can be found, and what is no fault."""

from collections.abc import Sequence
from typing import Any

import pytest

from pointit.diagnosis.diagnose import diagnose, is_healthy
from pointit.diagnosis.observation import DiagnosisReport, Finding, Observation
from pointit.diagnosis.symptoms import POSITION_SIGMA, SURE_DEG, UNSURE_DEG, UNSURE_M, YAW_SIGMA
from pointit.schemas import Deployment, ExpectedService, Health, KeyHealth, Quantiles
from pointit.schemas.problems import Problem
from pointit.schemas.system import split_instance
from pointit.schemas.topics import CURSOR, FEEDBACK, HOVER, IMU, RAY, Topic
from pointit.services.registry import person_of

NOW_S = 103.0
SHARED = ("pui", "selector")
BEGAN_S = 100.0


def key(topic: Topic[Any], direction: str, age_s: float | None = 0.01, **counts: int) -> KeyHealth:
    return KeyHealth.model_validate(
        {"key": topic.key, "direction": direction, "rate_hz": 50.0, "age_s": age_s, **counts}
    )


def health(instance: str, *keys: KeyHealth, **fields: Any) -> Health:
    service, user = split_instance(instance)
    values: dict[str, Any] = {"pid": 7, "uptime_s": 60.0, **fields}
    return Health.model_validate(
        {"stamp_ns": 0, "service": service, "user": user, "instance": instance, "keys": keys, **values}
    )


def observation(*newest: Health, before: Sequence[Health] = (), **fields: Any) -> Observation:
    """Return an observation with `newest` reports of now and `before` reports of a second earlier.

    If they are of people, what people need is present.
    """
    reports: dict[str, list[DiagnosisReport]] = {}
    for time_s, messages in ((NOW_S - 1.1, before), (NOW_S - 0.1, newest)):
        for message in messages:
            reports.setdefault(message.instance, []).append(
                DiagnosisReport(received_s=time_s, health=message)
            )
    shared = SHARED if any(map(person_of, reports)) else ()
    values: dict[str, Any] = {"present": frozenset((*reports, *shared)), **fields}
    return Observation(began_s=BEGAN_S, now_s=NOW_S, reports=reports, **values)


def deployment(*services: ExpectedService) -> dict[str, Deployment]:
    return {"run.scenario_3": Deployment(stamp_ns=0, name="scenario_3", services=services)}


def only(seen: Observation) -> Finding:
    (finding,) = diagnose(seen)
    assert is_healthy([finding]) == (finding.severity == "note")
    return finding


WELL = (
    health("user-sim.anna", key(IMU, "out"), key(CURSOR, "in")),
    health("pointing.anna", key(IMU, "in"), key(RAY, "out"), latency=Quantiles(p50_s=0.001, p99_s=0.1)),
    health("pui", key(RAY, "in"), key(CURSOR, "out")),
    health("selector", key(CURSOR, "in"), key(HOVER, "out"), key(FEEDBACK, "out")),
)


def test_a_router_alone_is_no_site_that_is_well() -> None:
    for routers in (("router",), ("router", "router-hall")):
        finding = only(observation(*map(health, routers)))
        assert (finding.code, finding.severity) == ("empty", "error")
        assert "nothing but the router" in finding.sentence
        assert "`pointit run --site-only" in finding.remedy
    assert diagnose(observation(health("router"), health("led-driver"))) == []


def test_things_of_a_disconnected_home_assistant_are_named() -> None:
    finding = only(observation(WELL[2], home_things=("desk", "fan")))
    assert (finding.code, finding.severity) == ("no-bridge", "warning")
    assert "is not connected: pointing at desk and fan switches nothing there" in finding.sentence
    assert "add --with home-assistant to `pointit run`" in finding.remedy
    assert diagnose(observation(WELL[2], health("home-assistant"), home_things=("desk",))) == []
    gone = only(observation(WELL[2], left=frozenset({"home-assistant"}), home_things=("desk",)))
    assert gone.code == "left", "one finding of one problem"


def test_restart_command_reaches_the_site_that_was_looked_at() -> None:
    gone = ExpectedService(service="keeper", command=("python", "-m", "x"))
    options = " --site hall --connect tcp/a:1"
    seen = observation(WELL[2], deployments=deployment(gone), left=frozenset({"led-driver"}), options=options)
    remedies = {finding.service: finding.remedy for finding in diagnose(seen)}
    assert remedies["keeper"].startswith(f"start it again: `pointit service run keeper{options}` (")
    assert remedies["led-driver"] == f"if it should run: `pointit service run led-driver{options}`"


def certainty(**figures: float) -> Health:
    names = {"age": ("anchor age", "s"), "place": (POSITION_SIGMA, "m"), "yaw": (YAW_SIGMA, "°")}
    return health(
        "localizer.anna",
        figures=tuple(
            {"name": names[short][0], "value": value, "unit": names[short][1]}
            for short, value in figures.items()
        ),
    )


def imu_of(written_s: float | None, read_s: float | None) -> Observation:
    """Return a site where a wrist was written and read at these ages."""
    return observation(
        health("user-sim.anna", key(IMU, "out", written_s)), health("pointing.anna", key(IMU, "in", read_s))
    )


FINDINGS: dict[str, tuple[Observation, str, str, str]] = {
    "a service that has not reported from the beginning": (
        Observation(began_s=BEGAN_S, now_s=BEGAN_S + 3.1, present=frozenset({"pui"})),
        "error silent pui", "stopped, overloaded or cut off", ""),
    "two processes under one name": (
        observation(health("pui", pid=8), before=[health("pui", pid=7)]),
        "error twice pui", "7 on ? and 8 on ?", ""),
    "an old input though its writer runs": (
        imu_of(1.5, 1.5), "error stale pointing.anna", "user-sim.anna", "or input ended?"),
    "no input though its writer runs": (
        imu_of(None, None), "error stale pointing.anna", "user-sim.anna", "or input ended?"),
    "an input that is written is lost in between": (
        imu_of(0.01, 1.5), "error stale pointing.anna", "", "does write it: what is between the two?"),
    "a cursor that is written does not arrive": (
        observation(health("pui", key(CURSOR, "out")), health("selector", key(CURSOR, "in", 9.0))),
        "error stale selector", "", ""),
    "errors of handlers": (
        observation(health("pui", errors=2), before=[health("pui", errors=1)]),
        "error failing pui", "", "traceback"),
    "a high latency": (
        observation(health("pui", latency=Quantiles(p50_s=0.05, p99_s=0.151))),
        "warning slow pui", "151 ms", ""),
    "an uncertain position": (
        observation(certainty(place=UNSURE_M + 0.01, yaw=2.0)),
        "warning unsure localizer.anna", "position is uncertain by", "press anna --gesture hold"),
    "an uncertain yaw": (
        observation(certainty(place=0.2, yaw=UNSURE_DEG + 0.1)),
        "warning unsure localizer.anna", "yaw is uncertain by", "`pointit person anchor anna`"),
    "an old anchor": (
        observation(certainty(yaw=SURE_DEG + 0.1, age=400.0)),
        "warning old-anchor localizer.anna", "anchor is 7 min old", "`pointit person anchor anna`"),
}  # fmt: skip


@pytest.mark.parametrize("name", FINDINGS)
def test_each_fault_alone_is_one_finding(name: str) -> None:
    seen, expected, sentence, remedy = FINDINGS[name]
    finding = only(seen)
    assert f"{finding.severity} {finding.code} {finding.service}" == expected
    assert sentence in finding.sentence
    assert remedy in finding.remedy


def test_three_seconds_without_a_report_are_not_yet_silence() -> None:
    assert not diagnose(observation(present=frozenset({"pui"})))


def test_service_that_leaves_during_the_observation_is_a_finding() -> None:
    finding = only(observation(WELL[2], left=frozenset({"selector"})))
    assert (finding.code, finding.severity, finding.service) == ("left", "warning", "selector")
    assert "pointit service run selector" in finding.remedy


def test_restarted_service_is_no_duplicate() -> None:
    assert not diagnose(observation(health("pui", pid=8, uptime_s=0.5), before=[health("pui", pid=7)]))


def test_stale_input_is_explained_by_what_the_writer_says() -> None:
    source = health(
        "user-sim.anna", key(IMU, "out", None), warnings=("there is no lamp; choose another map",)
    )
    reader = health("pointing.anna", key(IMU, "in", None))
    stale = next(f for f in diagnose(observation(source, reader)) if f.code == "stale")
    assert stale.remedy == "look at user-sim.anna, which says: “there is no lamp; choose another map”"


def test_stale_is_said_of_the_first_cause_only() -> None:
    finding = only(
        observation(
            health("user-sim.anna", key(IMU, "out", 9.0)),
            health("pointing.anna", key(IMU, "in", 9.0), key(RAY, "out", 9.0)),
            health("pui", key(RAY, "in", 9.0), key(CURSOR, "out", 9.0)),
        )
    )
    assert finding.service == "pointing.anna"


def test_stale_because_the_writer_is_silent_is_the_writers_finding() -> None:
    heard = (health("pui", key(RAY, "in", 3.0)), health("selector"))
    reports = {each.instance: [DiagnosisReport(received_s=BEGAN_S + 3, health=each)] for each in heard}
    present = frozenset({*reports, "pointing.anna"})
    seen = Observation(began_s=BEGAN_S, now_s=BEGAN_S + 3.4, present=present, reports=reports)
    assert only(seen).code == "silent"


@pytest.mark.parametrize(
    ("writer", "reader"),
    [
        (None, health("pointing.anna", key(IMU, "in", 9.0))),  # nobody is there who should write
        (health("user-sim.ben", key(IMU, "out")), health("pointing.anna", key(IMU, "in", 9.0))),  # not hers
        (health("user-sim.anna", key(IMU, "out")), health("pointing.anna", key(IMU, "in", 0.9))),  # a pause
        (
            health("user-sim.anna", key(IMU, "out")),
            health("pointing.anna", key(IMU, "in", None), uptime_s=1.0),  # has just begun
        ),
        (health("pui", key(CURSOR, "out", 9.0)), health("selector", key(CURSOR, "in", 9.0))),  # nobody points
        (
            health("selector", key(FEEDBACK, "out", 9.0)),
            health("supervisor.anna", key(FEEDBACK, "in", 9.0)),  # comes on occasion
        ),
        (health("ros2", key(RAY, "out", 9.0)), health("pui", key(RAY, "in", 9.0))),  # passes on what comes
    ],
)
def test_old_input_that_is_no_fault(writer: Health | None, reader: Health) -> None:
    services = (*([writer] if writer else []), reader)
    bens = {"pointing.ben"} if "user-sim.ben" in {each.instance for each in services} else set[str]()
    present = frozenset({*SHARED, *bens, *(each.instance for each in services)})
    assert not diagnose(observation(*services, present=present))


def test_slow_simulations_have_slow_rates() -> None:
    pair = (health("user-sim.anna", key(IMU, "out", 1.5)), health("pointing.anna", key(IMU, "in", 1.5)))
    assert only(observation(*pair, speed=1.0)).code == "stale"
    assert not diagnose(observation(*pair, speed=0.1))


@pytest.mark.parametrize(("topic", "counter"), [(IMU, "invalid"), (FEEDBACK, "lost"), (FEEDBACK, "dropped")])
def test_counters_are_errors_while_growing_and_notes_afterwards(topic: Topic[Any], counter: str) -> None:
    five, six = (health("pui", key(topic, "in", **{counter: count})) for count in (5, 6))
    growing = only(observation(six, before=[five]))
    assert (growing.code, growing.severity) == ("failing", "error")
    assert growing.sentence.startswith("6 ")
    assert topic.at("*") in growing.sentence
    assert growing.sentence.endswith("; the number is growing")
    past = only(observation(six, before=[six]))
    assert (past.code, past.severity) == ("failed", "note")


def test_only_the_newest_counts_elsewhere_so_drops_are_no_fault() -> None:
    assert not diagnose(observation(health("pui", key(IMU, "in", dropped=9))))


def late(instance: str, p99_s: float, **fields: float) -> Health:
    return health(instance, latency=Quantiles(p50_s=0.05, p99_s=p99_s), **fields)


def test_latency_of_one_peak_or_new_service_is_no_finding() -> None:
    assert diagnose(observation(late("pui", 0.2), before=[late("pui", 0.01)])) == []
    assert diagnose(observation(late("pui", 0.2, uptime_s=4.9))) == []
    assert only(observation(late("pui", 0.2), before=[late("pui", 0.2)])).code == "slow"


def test_first_slow_service_is_the_finding_and_its_readers_follow() -> None:
    seen = observation(
        late("selector", 0.3), late("pui", 0.2), late("led-driver", 0.31), late("pointing.anna", 0.1)
    )
    found = {each.service: each.follows for each in diagnose(seen)}
    assert found == {"selector": True, "pui": False, "led-driver": True}


@pytest.mark.parametrize(
    "figures",
    [
        {},
        {"place": UNSURE_M, "yaw": UNSURE_DEG, "age": 10.0},
        {"yaw": SURE_DEG - 0.1, "age": 4000.0},
        {"age": 179.0},
    ],
)
def test_pose_within_the_limits_has_no_finding(figures: dict[str, float]) -> None:
    assert not diagnose(observation(certainty(**figures)))


def test_uncertainty_that_the_localizer_reports_itself_is_one_finding() -> None:
    sentence = "the yaw of anna is uncertain by 14°, since IMUs drift; have them point at a lamp once"
    warned = certainty(yaw=14.0).model_copy(update={"warnings": (sentence,), "status": "degraded"})
    finding = only(observation(warned))
    assert (finding.sentence, finding.remedy) == (f"says: “{sentence}”", "")  # it says what to do itself


def test_selectors_report_of_refused_acts_yields_to_the_carriers_own() -> None:
    fields = {"code": "refused-acts", "sentence": "acts on radio are refused: no power", "subject": "hue"}
    selector = health("selector").model_copy(update={"problems": (Problem.model_validate(fields),)})
    assert only(observation(selector)).sentence == fields["sentence"]
    assert diagnose(observation(selector, present=frozenset({"selector", "hue"}))) == []
