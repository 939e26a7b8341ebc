"""`pointit doctor`: running services, stale data, problems and remedies."""

import asyncio
import dataclasses
import datetime as dt
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import click
from rich.text import Text

from pointit.cli.common import site_link
from pointit.cli.common.output import (
    INTERRUPTED,
    OutputSection,
    Row,
    console,
    duration_text,
    json_option,
    print_json,
    print_table,
)
from pointit.cli.common.panels import Finite
from pointit.cli.site import expiring, section, visible_rows
from pointit.diagnosis.causes import may_pass, unreachable
from pointit.diagnosis.diagnose import diagnose, filter_findings, is_about, is_healthy
from pointit.diagnosis.missing_services import home_things, is_anything_starting
from pointit.diagnosis.observation import DiagnosisReport, Finding, Observation, stopped_processes
from pointit.runtime.clock import wait_up_to
from pointit.runtime.errors import ConnectError, RejectedError
from pointit.runtime.host.advised_commands import advised_commands
from pointit.runtime.host.extras import CHECKOUT
from pointit.runtime.link.link import DEFAULT_ENDPOINT, DEFAULT_SITE, SILENT_S, Link
from pointit.runtime.link.options import given_credentials
from pointit.runtime.machine import this_machine
from pointit.runtime.service.process import EXIT_FAILED, run_until_shutdown
from pointit.runtime.zenoh.connections import sites_at
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Health, Interaction, Quantiles
from pointit.schemas.system import split_instance
from pointit.schemas.topics import ANY, CLOCK, DEPLOYMENT, HEALTH, INTERACTION, MAP, SHARD_ALIVE
from pointit.services.registry import add_installed, person_of
from pointit.site.following import follow_site
from pointit.site.site_state import Change, SiteState

MIN_S = 1.2
"""Minimum listening time: long enough for services that report once a second."""

LONGEST_S = SILENT_S + 0.4
"""Listening time after which services not heard count as silent."""

CONFIRM_S = 6.0
"""Listening time in which a pause of a busy machine passes: its own start makes one, too."""

STARTS_S = 120.0
"""Listening time after which a service that is starting counts as missing."""

CHECK_S = 0.5
"""Period of checks if nothing arrives."""

HELP = CHECKOUT / "docs/how-to/troubleshooting.md"
"""Page with a line for the code of each finding, in a checkout."""

STYLES = {"error": "red", "warning": "yellow", "note": "dim"}

ROOMY_COLUMNS = frozenset({"pid", "host", "in_hz", "out_hz"})
"""Columns not shown by a narrow terminal."""


def _options(link: Link) -> str:
    """Return the options by which another command reaches the same site; "" if the defaults do.

    Of a secured site these are the credentials of each identity.
    """
    if link.credentials is not None:
        return ""
    options = "" if link.site == DEFAULT_SITE else f" --site {link.site}"
    for endpoint in link.connect:
        if endpoint != DEFAULT_ENDPOINT:
            options += f" --connect {endpoint}"
    return options


def _identities(link: Link) -> str:
    """Return the folder of the identities of a secured site, as far as it is here, else `""`."""
    if link.credentials is None:
        return ""
    folder = link.credentials.folder.parent
    return str(folder) if (folder / "supervisor").is_dir() else "FOLDER/identities"


class SiteObserver:
    """Observes until every service, or every one of a name, was heard twice."""

    def __init__(self, only: str = "") -> None:
        self._only = only
        self.seen: Observation | None = None
        self._began_s = time.monotonic()
        self._changed = asyncio.Event()
        self._site = SiteState(self._on_change, on_service=lambda *_: self._changed.set())
        self._shards: set[str] = set()
        self._reports: dict[str, list[DiagnosisReport]] = {}

    async def watch(self, bus: ZenohBus) -> None:
        """Observe until there is enough data; `seen` holds it afterwards."""
        self._began_s = time.monotonic()
        follow_site(self._site, bus, time.monotonic, (CLOCK, DEPLOYMENT, HEALTH, INTERACTION, MAP))
        bus.watch(SHARD_ALIVE, self._on_shard)
        await asyncio.sleep(MIN_S)
        while time.monotonic() < self._end_s(bus.link):
            self._changed.clear()
            await wait_up_to(self._changed, CHECK_S)

        # A site without processes may be another one, or one that may not be viewed
        observation = self._observe(bus.link)
        other_sites: tuple[str, ...] = ()
        denied = ""
        if not self._site.services and not self._site.all(DEPLOYMENT):
            if bus.link.credentials is None:  # with credentials there is a site
                other_sites = await sites_at(bus.link)
            denied = await bus.denial_reason("reads", HEALTH, ANY)
        self.seen = dataclasses.replace(observation, is_patient=False, other_sites=other_sites, denied=denied)

    def _observe(self, link: Link) -> Observation:
        now_s = time.monotonic()
        site = self._site
        room = site.get(MAP)
        tick = site.get(CLOCK)
        reports = {name: tuple(own) for name, own in self._reports.items()}
        return Observation(
            began_s=self._began_s,
            now_s=now_s,
            present=site.services,
            left=site.former_services,
            shards=frozenset(self._shards),
            reports=reports,
            deployments=dict(site.all(DEPLOYMENT)),
            interactions=dict(site.all(INTERACTION)),
            home_things=() if room is None else home_things(room),
            host=this_machine().host_name,
            stopped=stopped_processes(link.site, link.addresses),
            now_ns=this_machine().now_ns(),
            speed=1.0 if tick is None else tick.speed,
            options=_options(link),
            identities=_identities(link),
            commands=advised_commands(),
        )

    def _end_s(self, link: Link) -> float:
        return self._began_s + self._listening_s(self._observe(link))

    def _listening_s(self, seen: Observation) -> float:
        """Return the listening time, s: longer while services start, or while a problem may pass."""
        instances = _instances_about(seen.present, self._only)
        report_counts = [len(seen.reports.get(instance, ())) for instance in instances]

        # A stopped process does not start, so nothing is waited for
        if not seen.stopped and is_anything_starting(seen):
            return STARTS_S
        is_absent = bool(self._only) and not instances
        if is_absent or min(report_counts, default=2) < 2:
            return LONGEST_S
        return CONFIRM_S if any(map(may_pass, diagnose(seen))) else 0.0

    def _on_shard(self, name: str, *, present: bool) -> None:
        if present:
            self._shards.add(name)
        else:
            self._shards.discard(name)

    def _on_change(self, change: Change) -> None:
        health = change.message
        if isinstance(health, Health):
            report = DiagnosisReport(
                received_s=time.monotonic(), health=health, arrived_ns=this_machine().now_ns()
            )
            self._reports.setdefault(change.name, []).append(report)
            self._changed.set()


def _instances_about(instances: Iterable[str], only: str) -> list[str]:
    """Return the instances of a service or person, or all if `only` is `""`, sorted."""
    selection = sorted(instances)
    if only:
        selection = [instance for instance in selection if is_about(instance, only)]
    return selection


@click.command("doctor", params=site_link.site_options())
@click.option(
    "--timeout",
    "timeout_s",
    type=Finite(min=0),
    default=site_link.TIMEOUT_S,
    help="time to look for the site, s",
)
@click.option(
    "--only", default="", show_default=False, metavar="NAME", help="show only this service or person"
)
@click.option(
    "--site-folder",
    "folder",
    type=click.Path(path_type=Path),
    help="show the expiry of all certificates in this site's folder  [default: the folder that contains the "
    "credentials; without one, only their certificate]",
)
@json_option
def command(
    *, timeout_s: float, only: str, folder: Path | None, as_json: bool, site: str, connect: tuple[str, ...]
) -> int:
    """Show services of a site, outdated reports, problems and remedies.

    Listens for one to six seconds, and longer while services start. The exit code is 0 if all is well, 1 if
    something is wrong (notes about past problems do not count), 130 if Ctrl-C ended it before it had a
    result. With --only it is also 1 if nothing of that name runs. On a secured site it also shows when
    certificates expire.

    Example: pointit doctor --only pui
    """
    site_link.quiet()
    add_installed()
    credentials = given_credentials()
    identities = visible_rows(credentials, folder, dt.datetime.now(dt.UTC))
    if only:
        identities = [row for row in identities if row["name"] == only]

    # A site that cannot be joined is one finding
    observer = SiteObserver(only)
    try:
        run_until_shutdown(_listen(observer, site, connect, timeout_s))
    except ConnectError as error:
        is_refused = all(site_link.listens(endpoint) is False for endpoint in connect)
        finding = unreachable(
            connect,
            stopped_processes(site, connect),
            is_refused=is_refused,
            is_secured=credentials is not None,
            rejection=str(error) if isinstance(error, RejectedError) else "",
            commands=advised_commands(),
        )
        nothing = Observation(began_s=0.0, now_s=0.0)
        return _print_report(nothing, [finding], identities, site, as_json=as_json)
    if observer.seen is None:
        return INTERRUPTED

    findings = diagnose(observer.seen)
    if only:
        findings = filter_findings(findings, observer.seen, only)
    return _print_report(observer.seen, findings, identities, site, only=only, as_json=as_json)


async def _listen(observer: SiteObserver, site: str, connect: tuple[str, ...], timeout_s: float) -> int:
    async with site_link.join_site(site, connect, timeout_s=timeout_s) as bus:
        with site_link.notify_if_slow(f"listening to {site_link.address(site, connect)} …"):
            await observer.watch(bus)
    return 0


def _print_report(
    seen: Observation,
    findings: list[Finding],
    identities: Sequence[Row],
    site: str,
    *,
    only: str = "",
    as_json: bool,
) -> int:
    instances = _instances_about(seen.present | seen.expected.keys(), only)
    if as_json:
        _print_json_report(seen, findings, identities, site, only)
    else:
        _print_tables(seen, instances, findings, identities, site)
        _print_findings(findings)
        _print_closing(seen, findings, instances, only)
    return 0 if is_healthy(findings) else EXIT_FAILED


def _print_json_report(
    seen: Observation, findings: list[Finding], identities: Sequence[Row], site: str, only: str
) -> None:
    instances = _instances_about(seen.present | seen.expected.keys(), only)
    problems = [dataclasses.asdict(finding) for finding in findings if not finding.follows]
    consequences = [dataclasses.asdict(finding) for finding in findings if finding.follows]
    people: list[Row] = []
    for user, person in _people(seen, only):
        people.append({"user": user, "state": person.state, "next_step": person.next_step})

    # Commands in deployments are others', and operators copy what they see
    deployments: dict[str, Any] = {}
    for name, deployment in seen.deployments.items():
        deployments[name] = deployment.model_dump(exclude={"services": {"__all__": {"command"}}})
    report = {
        "site": site,
        "healthy": is_healthy(findings),
        "services": [_record(seen, instance) for instance in instances],
        "findings": problems,
        "consequences": consequences,
        "people": people,
        "identities": identities,
        "deployments": deployments,
    }
    print_json(report)


def _print_tables(
    seen: Observation,
    instances: Sequence[str],
    findings: Sequence[Finding],
    identities: Sequence[Row],
    site: str,
) -> None:
    screen = console()
    if instances:
        rows = tuple(_row(seen, instance, findings) for instance in instances)
        services = OutputSection(name="services", about=f"of site {site}", rows=rows, roomy=ROOMY_COLUMNS)
        print_table(screen, services)

    # Metrics of a service's own, which are too many for columns
    figures: list[Row] = []
    for instance in instances:
        health = seen.newest(instance)
        if health is not None and health.figures:
            service, user = _service_and_user(instance)
            figures.append({"service": service, "user": user, "figures": _figures(health)})
    if figures:
        measurements = OutputSection(name="figures", about="further measurements", rows=tuple(figures))
        print_table(screen, measurements)

    # The own certificates were reported at the start
    if identities:
        print_table(screen, section(identities))
    others = expiring(row for row in identities if not row["own"])
    if others:
        click.echo(f"Warning: {', '.join(others)}: renew with `pointit site renew`", err=True)


def _print_closing(
    seen: Observation, findings: Sequence[Finding], instances: Sequence[str], only: str
) -> None:
    screen = console()
    for sentence in _next_steps(seen, only):
        screen.print(Text(sentence, style="dim"))
    if is_healthy(findings):
        services_run = f"{len(instances)} services run"
        if len(instances) == 1:
            services_run = "1 service runs"
        screen.print(Text(f"all is well: {services_run}", style="green"))


def _print_findings(findings: Sequence[Finding]) -> None:
    """Print the findings with their remedies, and the number of those that follow from them."""
    screen = console()
    consequences = 0
    for finding in findings:
        if finding.follows:
            consequences += 1
            continue
        text = Text.assemble((f"{finding.severity}: ", STYLES[finding.severity]))
        if finding.service:
            text.append(f"{finding.service}: ")
        text.append(finding.sentence)
        text.append(f" [{finding.code}]", "dim")
        if finding.remedy:
            text.append(f"\n    -> {finding.remedy}")
        screen.print(text)
    if consequences:
        screen.print(Text(f"    {consequences} more follow from it (--json lists them)", style="dim"))
    if findings and HELP.is_file():
        screen.print(Text(f"each code in brackets is explained in {HELP}", style="dim"))


def _people(seen: Observation, only: str) -> list[tuple[str, Interaction]]:
    """Return the people with their states, by name. `only`: a person or service, or `""` for all."""
    people = sorted(seen.interactions.items())
    if only:
        people = [(user, interaction) for user, interaction in people if user == only]
    return people


def _next_steps(seen: Observation, only: str) -> list[str]:
    """Return the next step of each person who does not point, in one sentence each."""
    sentences: list[str] = []
    for user, interaction in _people(seen, only):
        if interaction.next_step and interaction.state != "pointing":
            sentences.append(f"next step of {user}: {interaction.next_step}")
    return sentences


def _record(seen: Observation, instance: str) -> Row:
    health = seen.newest(instance)
    return {
        "instance": instance,
        "service": split_instance(instance)[0],
        "user": person_of(instance),
        "present": instance in seen.present,
        "expected": instance in seen.expected,
        "health": None if health is None else health.model_dump(),
    }


def _service_and_user(instance: str) -> tuple[str, str]:
    """Return the name and the person of the table: `pointing` of `anna`, or a shared service's whole name."""
    user = person_of(instance)
    return (split_instance(instance)[0], user) if user else (instance, "")


def _row(seen: Observation, instance: str, findings: Sequence[Finding]) -> Row:
    service, user = _service_and_user(instance)
    row: dict[str, Any] = {
        "service": service,
        "user": user,
        "pid": None,
        "host": None,
        "up": None,
        "in_hz": "",
        "out_hz": "",
        "step_ms": None,
        "latency_ms": None,
        "status": _status(instance, findings),
    }
    health = seen.newest(instance)
    if health is not None and instance in seen.present:
        row["pid"] = health.pid
        row["host"] = health.host
        row["up"] = duration_text(health.uptime_s)
        row["in_hz"] = _rates(health, "in")
        row["out_hz"] = _rates(health, "out")
        row["step_ms"] = _quantiles(health.step)
        row["latency_ms"] = _quantiles(health.latency)
    return row


def _status(instance: str, findings: Sequence[Finding]) -> Text:
    for finding in findings:
        if finding.service == instance and finding.severity != "note":
            return Text(finding.code, style=STYLES[finding.severity])
    return Text("ok", style="green")


def _rates(health: Health, direction: str) -> str:
    """Return the rates as `imu 50, ray 50`, by the last part of the keys."""
    rates: list[str] = []
    for key in health.keys:
        if key.direction == direction and key.rate_hz > 0:
            rates.append(f"{_last_name(key.key)} {key.rate_hz:.0f}")
    return ", ".join(rates)


def _last_name(key: str) -> str:
    """Return the last part of a key that is no placeholder."""
    parts = key.split("/")
    names = [part for part in parts if "{" not in part]
    return names[-1]


def _figures(health: Health) -> str:
    """Return a service's own metrics as `drift 3.1 °/min, anchor age 12 s`."""
    figures: list[str] = []
    for metric in health.figures:
        gap = "" if metric.unit in ("", "°") else " "
        value = f"{metric.value:.3g}{gap}{metric.unit}"
        figures.append(f"{metric.name} {value}")
    return ", ".join(figures)


def _quantiles(times: Quantiles | None) -> str:
    if times is None:
        return ""
    p50_ms = times.p50_s * 1e3
    p99_ms = times.p99_s * 1e3
    return f"{p50_ms:.2f}/{p99_ms:.2f}"
