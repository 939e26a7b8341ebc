"""Each broken situation of the table is one finding, whose step mends it; the page for users is current."""

import re
from dataclasses import replace

import pytest

from pointit.diagnosis.diagnose import diagnose, is_healthy
from pointit.services.registry import person_of
from tests.support.remedies import check_sentence
from tests.unit.deploy.stack import parse
from tests.unit.diagnosis.fault_sites import Site
from tests.unit.diagnosis.page import PAGE, cause, commands, page
from tests.unit.diagnosis.situations import SITUATIONS, Situation

rows = pytest.mark.parametrize("row", SITUATIONS, ids=lambda row: row.name)


def restart(site: Site, healthy: Site, instance: str) -> None:
    """Start the process of a service again."""
    name = healthy.process_of(instance)
    site.processes[name] = healthy.processes[name]


def apply(text: str, site: Site, healthy: Site) -> bool:
    """Do what the commands in `text` do to the site. Return False if they are for other processes."""
    before = dict(site.processes)
    for pid in re.findall(r"kill -CONT (\d+)", text):
        for name, process in healthy.processes.items():
            if process.pid == int(pid):
                site.processes[name] = process
                site.options.pop("stopped", None)
                site.deployments |= healthy.deployments
    for service, user in re.findall(r"pointit service run ([a-z-]+)(?: --user (\w+))?", text):
        restart(site, healthy, f"{service}.{user}" if user else service)
    for person in re.findall(r"pointit person add (\w+)", text):
        if person in healthy.processes:
            site.processes[person] = healthy.processes[person]
    if re.search(r"pointit run(?! --site-only --credentials FOLDER)", text):
        site.processes |= {name: each for name, each in healthy.processes.items() if name in ("run", "site")}
        site.deployments |= healthy.deployments
    return site.processes != before


def test_the_table_has_at_least_forty_rows_of_different_names() -> None:
    assert len({each.name for each in SITUATIONS}) == len(SITUATIONS) >= 40


@rows
def test_the_cause_is_the_only_finding_and_its_step_can_be_typed(row: Situation) -> None:
    findings = row.findings()
    finding = cause(findings, row)
    others = [each for each in findings if each is not finding]
    assert len(others) == row.claims
    assert all(person_of(each.service) for each in others), "only a person's claims stand beside it"
    assert row.words in finding.sentence
    assert row.step in f"{finding.sentence} {finding.remedy}"
    assert is_healthy(findings) == (finding.severity == "note")
    check_sentence(f"{finding.sentence} {finding.remedy}")
    for words in commands(f"{finding.sentence} {finding.remedy}"):
        parse(words)


COMMANDS = ("is killed", "is stopped", "has ended", "have ended", "are stopped")


@pytest.mark.parametrize(
    "row",
    [each for each in SITUATIONS if any(map(each.name.__contains__, COMMANDS)) and not each.is_outside],
    ids=lambda row: row.name,
)
def test_the_printed_command_mends_the_site(row: Situation) -> None:
    site, healthy = row.make(), row.make()
    row.break_it(site)
    finding = cause(diagnose(site.seen()), row)
    for name in [name for name, each in site.processes.items() if each.warnings]:
        site.processes[name] = replace(site.processes[name], warnings=())  # the lie of another ends
    process = healthy.processes.get(finding.service)  # where it runs, its number is known
    text = f"{finding.sentence} {finding.remedy}".replace("PID", str(process.pid) if process else "PID")
    assert apply(text, site, healthy), text
    assert diagnose(site.seen()) == []


@rows
def test_the_site_was_healthy_before(row: Situation) -> None:
    assert diagnose(row.make().seen()) == []


def test_the_page_is_current() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run python -m tests.unit.diagnosis.page"


def test_a_wrong_cause_is_noticed() -> None:
    row = replace(SITUATIONS[-1], code="absent")
    with pytest.raises(StopIteration):
        cause(row.findings(), row)
