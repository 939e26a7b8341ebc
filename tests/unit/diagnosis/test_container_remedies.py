"""Remedies of a site in containers name what is typed beside them, and containers of the compose files."""

import re
from collections.abc import Iterator
from dataclasses import replace

import pytest

from pointit.diagnosis.causes import unreachable
from pointit.diagnosis.diagnose import diagnose
from pointit.diagnosis.missing_services import find_empty_site
from pointit.diagnosis.observation import (
    SHARED_CONTAINERS,
    Finding,
    Observation,
    container_of,
    silence_reason,
)
from pointit.runtime.bus.memory_bus import no_answer
from pointit.runtime.host.advised_commands import CONTAINERS, AdvisedCommands
from pointit.schemas.topics import CURSOR, MAP, RAY, USE_MAP
from tests.unit.deploy.stack import DEPLOY, compose, parse
from tests.unit.diagnosis.situations import SITUATIONS, Situation

HALL = AdvisedCommands("hall")
PEOPLE = {"anna", "ben", "carla", "user1", "user2", "USER", "NAME"}
"""People of the situations, each in a container of that name."""
EXEC = re.compile(r"podman exec hall-(\S+) (pointit .*)")
CONTROL = re.compile(r"podman (?:restart|start|logs) (.*)")
COMPOSE = re.compile(
    r"SITE=hall podman-compose -p hall -f deploy/compose\.yaml (up -d|run --rm --no-deps init .*)"
)
OUTSIDE = {"pointit service run home-assistant", "timedatectl set-ntp true", "top"}
"""Commands that are typed outside of the containers."""

rows = pytest.mark.parametrize("row", SITUATIONS, ids=lambda row: row.name)


def findings_in_containers(row: Situation) -> Iterator[Finding]:
    """Yield doctor's findings of a situation, looked at from a container."""
    site = row.make()
    site.options["commands"] = HALL
    outside = [finding for fault in row.faults if isinstance(finding := fault.effect(site), Finding)]
    if not outside:
        yield from diagnose(site.seen())


def check_commands(text: str) -> None:
    """Check that each command in backquotes can be typed beside the containers of site `hall`."""
    names = {f"hall-{name}" for name in {*compose("compose.yaml")["services"], *PEOPLE}}
    for command in text.split("`")[1::2]:
        if " " not in command or command in OUTSIDE:
            continue  # a parameter, or a command of the system
        inside = EXEC.fullmatch(command)
        if inside:
            assert f"hall-{inside[1]}" in names, command
            words = inside[2].split()[1:]
            assert words == ["--version"] or parse([word for word in words if word != "…"]), command
            continue
        control = CONTROL.fullmatch(command)
        if control:
            assert {*control[1].split()} <= names, command
            continue
        assert COMPOSE.fullmatch(command), command


@rows
def test_remedies_in_containers_name_no_command_of_a_shell(row: Situation) -> None:
    for finding in findings_in_containers(row):
        check_commands(finding.remedy)
        assert "pointit run" not in finding.remedy
        assert "kill -CONT" not in finding.remedy


@pytest.mark.parametrize("is_refused", [True, False])
@pytest.mark.parametrize("is_secured", [True, False])
def test_router_of_containers_is_started_by_its_container(*, is_refused: bool, is_secured: bool) -> None:
    finding = unreachable(
        ["tls/router:7447"], (), is_refused=is_refused, is_secured=is_secured, commands=HALL
    )
    assert "`podman restart hall-router`" in finding.remedy
    check_commands(finding.remedy)


@pytest.mark.parametrize("present", [frozenset[str](), frozenset({"router-1234"})])
def test_empty_site_of_containers_is_started_by_compose(present: frozenset[str]) -> None:
    seen = Observation(began_s=0.0, now_s=9.0, present=present, commands=HALL)
    (finding,) = find_empty_site(seen)
    check_commands(finding.remedy)
    assert "up -d`" in finding.remedy


def test_usual_site_needs_no_settings_of_compose() -> None:
    assert AdvisedCommands("lab").compose("up -d") == "`podman-compose -f deploy/compose.yaml up -d`"
    assert "podman-compose -f deploy/compose.yaml up -d" in (DEPLOY / "README.md").read_text(encoding="utf-8")


def test_shared_containers_are_those_of_the_compose_file() -> None:
    started = {*compose("compose.yaml")["services"]} - {"init", "router", "user"}
    assert {*SHARED_CONTAINERS} == started
    for name, row in compose("compose.yaml", SITE="hall", USER_NAME="anna")["services"].items():
        expected = "anna" if name == "user" else name
        assert row["container_name"] == f"hall-{expected}"


@pytest.mark.parametrize(
    ("instance", "container"),
    [
        ("pui", "pui"),
        ("pointing.anna", "anna"),
        ("router-12ab", "router"),
        ("robot.quad", ""),
        ("web.2", ""),
        ("pointing.a;reboot", ""),
        ("pointing..", ""),
        ("goal.anna", "anna"),
    ],
)
def test_container_of_an_instance_is_its_service_or_person(instance: str, container: str) -> None:
    assert container_of(instance) == container


def test_sentences_of_a_process_follow_the_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "`pointit doctor`" in str(no_answer(USE_MAP, "pui/map"))

    monkeypatch.setenv(CONTAINERS, "hall")
    refusal = str(no_answer(USE_MAP, "pui/map"))
    assert "`podman exec hall-keeper pointit doctor`" in refusal
    silences = [silence_reason(topic, name, ()) for topic, name in ((RAY, "eve"), (CURSOR, "*"), (MAP, ""))]
    assert "`podman restart hall-eve`" in silences[0]
    assert "`podman restart hall-pui`" in silences[2]
    check_commands(refusal)


def test_renewal_in_containers_leads_to_a_section_of_the_readme() -> None:
    renewal = HALL.renewal("anna")
    check_commands(renewal)
    section = renewal.split("*")[1]
    assert f"## {section}\n" in (DEPLOY / "README.md").read_text(encoding="utf-8")
    assert AdvisedCommands().renewal("anna") == "`pointit site renew anna` and copy the folder here"


def test_observation_without_containers_names_commands_of_a_shell() -> None:
    seen = Observation(began_s=0.0, now_s=9.0, present=frozenset({"router-1234"}))
    (finding,) = find_empty_site(seen)
    assert "`pointit run --site-only" in finding.remedy
    (in_containers,) = find_empty_site(replace(seen, commands=HALL))
    assert in_containers.sentence == finding.sentence
