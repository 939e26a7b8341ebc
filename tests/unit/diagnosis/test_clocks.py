"""Machines' clocks that are apart: found by who looks, unless the keeper has said so."""

from collections.abc import Sequence

import pytest

from pointit.diagnosis.diagnose import diagnose, find_clock_skew, is_healthy
from pointit.diagnosis.observation import Observation, Report
from pointit.schemas import NS_PER_S, Health

NOW_NS = 1_700_000_000 * NS_PER_S


def reports(instance: str, host: str, ahead_s: float, *warnings: str) -> Sequence[Report]:
    return [
        Report(
            received_s=100.0 + second,
            arrived_ns=NOW_NS + second * NS_PER_S,
            health=Health(
                stamp_ns=NOW_NS + second * NS_PER_S + int((ahead_s - 0.002) * 1e9),
                service=instance,
                instance=instance,
                pid=1,
                host=host,
                warnings=warnings,
            ),
        )
        for second in range(3)
    ]


def seen(**by_instance: Sequence[Report]) -> Observation:
    return Observation(
        began_s=100.0, now_s=102.5, host="desk", present=frozenset(by_instance), reports=by_instance
    )


@pytest.mark.parametrize(
    ("ahead_s", "severity", "words"),
    [
        (0.08, "warning", "78 ms ahead of the clock of desk"),
        (-0.08, "warning", "80 ms behind the clock of desk"),
        (1.5, "error", "refused"),
        (-1.5, "error", "refused"),
    ],
)
def test_a_clock_apart_is_found(ahead_s: float, severity: str, words: str) -> None:
    site = seen(
        pui=reports("pui", "server", 0.0), led=reports("led", "desk", 0.0), sim=reports("sim", "pi", ahead_s)
    )
    (finding,) = find_clock_skew(site)
    assert (finding.code, finding.severity, finding.service) == ("clock", severity, "")
    assert "machine pi " in finding.sentence
    assert words in finding.sentence
    assert "NTP" in finding.remedy
    assert [found for found in diagnose(site) if found.code == "clock"] == [finding]
    assert not is_healthy([finding])


def test_what_the_keeper_has_said_is_not_said_twice() -> None:
    warning = "the clock of machine pi is 80 ms behind the clock of server: ..."
    site = seen(keeper=reports("keeper", "server", 0.0, warning), sim=reports("sim", "pi", -0.08))
    assert not list(find_clock_skew(site))


def test_unknown_times_are_nothing() -> None:
    site = seen(sim=[Report(received_s=101.0, health=reports("sim", "pi", 9.0)[0].health)])
    assert not list(find_clock_skew(site))
