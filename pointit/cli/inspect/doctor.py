"""`pointit doctor`: running services, stale data, problems and remedies."""

import asyncio
import dataclasses
import datetime as dt
import socket
import time
from collections.abc import Sequence
from pathlib import Path

import click
from rich.console import Console
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
from pointit.runtime.host.extras import CHECKOUT
from pointit.runtime.link.link import DEFAULT_ENDPOINT, DEFAULT_SITE, SILENT_S, Link
from pointit.runtime.link.options import given_credentials
from pointit.runtime.service.process import EXIT_FAILED, run_until_shutdown
from pointit.runtime.zenoh.connections import sites_at
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Health, Interaction, KeyHealth, Quantiles
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
    site = "" if link.site == DEFAULT_SITE else f" --site {link.site}"
    return site + "".join(f" --connect {each}" for each in link.connect if each != DEFAULT_ENDPOINT)


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
        bus.watch(
            SHARD_ALIVE,
            lambda name, *, present: (self._shards.add if present else self._shards.discard)(name),
        )
        await asyncio.sleep(MIN_S)
        while time.monotonic() < self._began_s + self._listening_s(self._observe(bus.link)):
            self._changed.clear()
            await wait_up_to(self._changed, CHECK_S)
        sees_no_process = not self._site.services and not self._site.all(DEPLOYMENT)
        is_open = sees_no_process and bus.link.credentials is None  # with credentials there is a site
        self.seen = dataclasses.replace(
            self._observe(bus.link),
            is_patient=False,
            other_sites=await sites_at(bus.link) if is_open else (),
            denied=await bus.denial_reason("reads", HEALTH, ANY) if sees_no_process else "",
        )

    def _observe(self, link: Link) -> Observation:
        reports = self._reports
        now_s = time.monotonic()
        site = self._site
        room = site.get(MAP)
        tick = site.get(CLOCK)
        return Observation(
            began_s=self._began_s,
            now_s=now_s,
            present=site.services,
            left=site.former_services,
            shards=frozenset(self._shards),
            reports={name: tuple(reports[name]) for name in reports},
            deployments=dict(site.all(DEPLOYMENT)),
            interactions=dict(site.all(INTERACTION)),
            home_things=() if room is None else home_things(room),
            host=socket.gethostname(),
            stopped=stopped_processes(link.site, link.addresses),
            now_ns=time.time_ns(),
            speed=1.0 if tick is None else tick.speed,
            options=_options(link),
            identities=_identities(link),
        )

    def _listening_s(self, seen: Observation) -> float:
        """Return the listening time, s: longer while services start, or while a problem may pass."""
        wanted = {each for each in seen.present if not self._only or is_about(each, self._only)}
        is_complete = all(len(seen.reports.get(instance, ())) >= 2 for instance in wanted)
        if not seen.stopped and is_anything_starting(seen):
            return STARTS_S
        if not is_complete or (self._only and not wanted):
            return LONGEST_S
        return CONFIRM_S if any(map(may_pass, diagnose(seen))) else 0.0

    def _on_change(self, change: Change) -> None:
        if isinstance(health := change.message, Health):
            self._reports.setdefault(change.name, []).append(
                DiagnosisReport(received_s=time.monotonic(), health=health, arrived_ns=time.time_ns())
            )
            self._changed.set()


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
    known = visible_rows(credentials, folder, dt.datetime.now(dt.UTC))
    known = [row for row in known if not only or row["name"] == only]
    observer = SiteObserver(only)
    try:
        run_until_shutdown(_listen(observer, site, connect, timeout_s))
    except ConnectError as error:
        is_refused = all(site_link.listens(each) is False for each in connect)
        stopped = stopped_processes(site, connect)
        finding = unreachable(
            connect,
            stopped,
            is_refused=is_refused,
            is_secured=credentials is not None,
            rejection=str(error) if isinstance(error, RejectedError) else "",
        )
        return _print_report(Observation(began_s=0.0, now_s=0.0), [finding], known, site, as_json=as_json)
    if observer.seen is None:
        return INTERRUPTED
    findings = diagnose(observer.seen)
    if only:
        findings = filter_findings(findings, observer.seen, only)
    return _print_report(observer.seen, findings, known, site, only=only, as_json=as_json)


async def _listen(observer: SiteObserver, site: str, connect: tuple[str, ...], timeout_s: float) -> int:
    async with site_link.join_site(site, connect, timeout_s=timeout_s) as bus:
        with site_link.notify_if_slow(f"listening to {site_link.address(site, connect)} …"):
            await observer.watch(bus)
    return 0


def _print_report(
    seen: Observation,
    findings: list[Finding],
    known: Sequence[Row],
    site: str,
    *,
    only: str = "",
    as_json: bool,
) -> int:
    healthy = is_healthy(findings)
    there = seen.present | seen.expected.keys()
    instances = sorted(each for each in there if not only or is_about(each, only))
    if as_json:
        print_json(
            {
                "site": site,
                "healthy": healthy,
                "services": [_record(seen, instance) for instance in instances],
                "findings": [dataclasses.asdict(finding) for finding in findings if not finding.follows],
                "consequences": [dataclasses.asdict(finding) for finding in findings if finding.follows],
                "people": [
                    {"user": user, "state": person.state, "next_step": person.next_step}
                    for user, person in _people(seen, only)
                ],
                "identities": known,
                "deployments": {
                    name: item.model_dump(exclude={"services": {"__all__": {"command"}}})  # others' commands
                    for name, item in seen.deployments.items()
                },
            }
        )
        return 0 if healthy else EXIT_FAILED
    screen = console()
    if instances:
        rows = tuple(_row(seen, instance, findings) for instance in instances)
        print_table(
            screen, OutputSection(name="services", about=f"of site {site}", rows=rows, roomy=ROOMY_COLUMNS)
        )
    figures = tuple(
        {"service": service, "user": user, "figures": _figures(health)}
        for instance in instances
        if (health := seen.newest(instance)) is not None and health.figures
        for service, user in [_service_and_user(instance)]
    )
    if figures:
        print_table(screen, OutputSection(name="figures", about="further measurements", rows=figures))
    if known:
        print_table(screen, section(known))
    if others := expiring(row for row in known if not row["own"]):  # the own ones were reported at the start
        click.echo(f"Warning: {', '.join(others)}: renew with `pointit site renew`", err=True)
    _print_findings(screen, findings)
    for sentence in _next_steps(seen, only):
        screen.print(Text(sentence, style="dim"))
    if healthy:
        many = "1 service runs" if len(instances) == 1 else f"{len(instances)} services run"
        screen.print(Text(f"all is well: {many}", style="green"))
    return 0 if healthy else EXIT_FAILED


def _print_findings(screen: Console, findings: Sequence[Finding]) -> None:
    """Print the findings with their remedies, and the number of those that follow from them."""
    for finding in (each for each in findings if not each.follows):
        who = f"{finding.service}: " if finding.service else ""
        screen.print(
            Text.assemble(
                (f"{finding.severity}: ", STYLES[finding.severity]),
                f"{who}{finding.sentence}",
                (f" [{finding.code}]", "dim"),
                f"\n    -> {finding.remedy}" if finding.remedy else "",
            )
        )
    if folded := sum(each.follows for each in findings):
        screen.print(Text(f"    {folded} more follow from it (--json lists them)", style="dim"))
    if findings and HELP.is_file():
        screen.print(Text(f"each code in brackets is explained in {HELP}", style="dim"))


def _people(seen: Observation, only: str) -> list[tuple[str, Interaction]]:
    """Return the people with their states, by name. `only`: a person or service, or `""` for all."""
    return [each for each in sorted(seen.interactions.items()) if only in ("", each[0])]


def _next_steps(seen: Observation, only: str) -> list[str]:
    """Return the next step of each person who does not point, in one sentence each."""
    resting = [each for each in _people(seen, only) if each[1].state != "pointing"]
    return [f"next step of {user}: {person.next_step}" for user, person in resting if person.next_step]


def _record(seen: Observation, instance: str) -> Row:
    health = seen.newest(instance)
    service = split_instance(instance)[0]
    user = person_of(instance)
    return {
        "instance": instance,
        "service": service,
        "user": user,
        "present": instance in seen.present,
        "expected": instance in seen.expected,
        "health": health.model_dump() if health is not None else None,
    }


def _service_and_user(instance: str) -> tuple[str, str]:
    """Return the name and the person of the table: `pointing` of `anna`, or a shared service's whole name."""
    user = person_of(instance)
    return (split_instance(instance)[0], user) if user else (instance, "")


def _row(seen: Observation, instance: str, findings: Sequence[Finding]) -> Row:
    health = seen.newest(instance) if instance in seen.present else None
    service, user = _service_and_user(instance)
    return {
        "service": service,
        "user": user,
        "pid": health.pid if health else None,
        "host": health.host if health else None,
        "up": duration_text(health.uptime_s) if health else None,
        "in_hz": _rates(health, "in"),
        "out_hz": _rates(health, "out"),
        "step_ms": _quantiles(health.step) if health else None,
        "latency_ms": _quantiles(health.latency) if health else None,
        "status": _status(instance, findings),
    }


def _status(instance: str, findings: Sequence[Finding]) -> Text:
    for finding in findings:
        if finding.service == instance and finding.severity != "note":
            return Text(finding.code, style=STYLES[finding.severity])
    return Text("ok", style="green")


def _rates(health: Health | None, direction: str) -> str:
    """Return the rates as `imu 50, ray 50`, by the last part of the keys."""
    keys: list[KeyHealth] = [
        key for key in (health.keys if health else ()) if key.direction == direction and key.rate_hz > 0
    ]
    names = ([part for part in key.key.split("/") if "{" not in part][-1] for key in keys)
    return ", ".join(f"{name} {key.rate_hz:.0f}" for name, key in zip(names, keys, strict=True))


def _figures(health: Health) -> str:
    """Return a service's own metrics as `drift 3.1 °/min, anchor age 12 s`."""
    return ", ".join(
        f"{shown.name} {shown.value:.3g}" + ("" if shown.unit in ("", "°") else " ") + shown.unit
        for shown in health.figures
    )


def _quantiles(times: Quantiles | None) -> str:
    return "" if times is None else f"{times.p50_s * 1e3:.2f}/{times.p99_s * 1e3:.2f}"
