"""Sites whose services are starting: nothing is missing before its time, and everything is after it."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from pointit.diagnosis.diagnose import diagnose, is_healthy
from pointit.schemas.topics import CURSOR, IMU
from tests.unit.diagnosis.fault_sites import (
    DEPLOYMENTS,
    SHARED,
    Process,
    Site,
    deployment,
    one_process,
    processes,
    services_of,
)
from tests.unit.diagnosis.test_fault_table import change, is_starting, problems


def test_service_is_missing_when_it_is_late_after_a_start() -> None:
    seen = is_starting(processes()).seen()
    assert not is_healthy(diagnose(replace(seen, is_patient=False)))
    late = processes()
    late.end("pui")
    assert [each.code for each in problems(diagnose(late.seen()))] == ["absent"]


def never_reports(site: Site) -> None:
    site.processes["pui"] = Process(77, "desk", ("pui",), (), silence_s=60.0)


def never_comes(site: Site) -> None:
    site.end("pui")


@pytest.mark.parametrize(("uptime_s", "is_well"), [(29.0, True), (31.0, False)])
@pytest.mark.parametrize(("fault", "code"), [(never_reports, "silent"), (never_comes, "absent")])
def test_a_process_may_load_for_thirty_seconds_before_it_counts(
    fault: Callable[[Site], None], code: str, uptime_s: float, *, is_well: bool
) -> None:
    site = processes()
    for process in site.processes.values():
        process.uptime_s = uptime_s
    fault(site)
    assert [each.code for each in problems(diagnose(site.seen()))] == ([] if is_well else [code])
    impatient = replace(site.seen(), is_patient=False)
    assert [each.code for each in problems(diagnose(impatient))] == [code]


@pytest.mark.parametrize(("uptime_s", "is_well"), [(9.0, True), (11.0, False)])
def test_service_of_a_running_process_may_start_for_ten_seconds(uptime_s: float, *, is_well: bool) -> None:
    site = one_process()
    shared = tuple(each for each in SHARED if each != "pui")
    change(site, "run", services=(*shared, *services_of("user1", "user2")), uptime_s=uptime_s)
    assert is_healthy(diagnose(site.seen())) == is_well


def test_missing_inputs_are_no_finding_before_the_writer_has_reported() -> None:
    site = processes()
    for process in site.processes.values():
        process.uptime_s = 20.0
    never_reports(site)
    site.ages_s |= {(reader, CURSOR, "in"): None for reader in ("selector", "led-driver")}
    assert diagnose(site.seen()) == []


@pytest.mark.parametrize("kind", ["--processes", "router"])
def test_processes_take_longer_to_begin_than_services_of_one(kind: str) -> None:
    site = is_starting(DEPLOYMENTS[kind]())
    for name in list(site.processes):
        if name != "router":
            del site.processes[name]
    site.processes["web"] = Process(7, "desk", ("web",), ("pointit", "dashboard"))
    seen = site.seen()
    assert seen.now_ns is not None
    later = replace(seen, now_ns=seen.now_ns + 30 * 10**9)
    assert diagnose(seen) == []
    assert is_healthy(diagnose(later)) == (kind == "--processes")


@pytest.mark.parametrize(
    ("writer_s", "output_s", "input_s", "is_well"),
    [
        *((2.5, output_s, None, True) for output_s in (None, 0.1)),
        *((3.5, output_s, None, False) for output_s in (None, 0.1)),
        pytest.param(2.5, 2.4, 2.4, False, id="has ended within three seconds of its writer's start"),
        (2.5, 2.6, 2.6, True),
    ],
)
def test_inputs_may_be_missing_in_their_writers_first_three_seconds(
    writer_s: float, output_s: float | None, input_s: float | None, *, is_well: bool
) -> None:
    site = processes()
    site.processes["user-sim.user1"].uptime_s = writer_s
    site.ages_s["user-sim.user1", IMU, "out"] = output_s
    site.ages_s |= {(f"{name}.user1", IMU, "in"): input_s for name in ("pointing", "localizer", "supervisor")}
    assert is_healthy(diagnose(site.seen())) == is_well


@pytest.mark.parametrize(("age_s", "is_well"), [(119.0, True), (121.0, False)])
def test_early_process_does_not_make_the_others_late(age_s: float, *, is_well: bool) -> None:
    site = processes()
    site.deployments = {"run.scenario_4": deployment("scenario_4", site.processes.values(), age_s)}
    site.processes = {"keeper": replace(site.processes["keeper"], silence_s=60.0)}
    assert is_healthy(diagnose(site.seen())) == is_well
