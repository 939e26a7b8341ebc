"""`pointit load`: the number of people that this machine, or a running site, carries."""

import os
import tempfile
from collections.abc import Sequence
from typing import Any

import click
from click.core import ParameterSource

from pointit.cli.common.output import INTERRUPTED, OutputSection, json_option, print_json, show
from pointit.cli.common.panels import Finite
from pointit.cli.common.site_link import quiet, site_options
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import VARIABLE
from pointit.runtime.link.link import VARIABLE as CREDENTIALS
from pointit.runtime.link.options import given_credentials
from pointit.runtime.service.process import EXIT_FAILED, run_until_shutdown
from pointit_lab.loadtest.layout import Layout, LoadParameters
from pointit_lab.loadtest.load_result import CapacitySearch, LoadResult
from pointit_lab.loadtest.measuring import measure
from pointit_lab.loadtest.network.routers import Program
from pointit_lab.loadtest.slopes import PartSlopes, slopes

MAX_USERS = 1000
FIRST = 5
"""Number of people at the start of a sweep."""
MAX_HOSTS = 16
MAX_ROUTERS = 32


class LoadCounts(click.ParamType[tuple[int, ...]]):
    """Whole numbers with commas between them."""

    name = "counts"

    def __init__(self, max_count: int) -> None:
        """Allow 1 to `max_count`."""
        self._max_count = max_count

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, ...]:
        """Return the numbers in `value`."""
        numbers: list[int] = []
        for part in str(value).split(","):
            is_number = part.strip().isdecimal()
            if not is_number or not 1 <= int(part) <= self._max_count:
                self.fail(f"{part!r} is not a whole number from 1 to {self._max_count}", param, ctx)
            numbers.append(int(part))
        return tuple(numbers)


@click.command("load", params=site_options())
@click.option(
    "--users",
    type=LoadCounts(MAX_USERS),
    default="10",
    metavar="N[,N]",
    help="number of people; several are measured in turn",
)
@click.option(
    "--rate", "rate_hz", type=Finite(min=1, max=1000), default=100.0, help="samples per second of each person"
)
@click.option(
    "--duration", "duration_s", type=Finite(min=0.5, max=86_400), default=10.0, help="measuring time, s"
)
@click.option(
    "--layout",
    type=click.Choice(["one", "users", "services"]),
    default="one",
    help="all in one process; people's services sharded over processes; one process per service",
)
@click.option(
    "--shards",
    type=click.IntRange(1, 256),
    default=os.cpu_count() or 1,
    show_default="the cores of this machine",
    help="number of processes for people with --layout users",
)
@click.option(
    "--router",
    type=click.Choice(["pointit", "zenohd"]),
    is_flag=False,
    flag_value="pointit",
    default=None,
    help="connect processes by a router, as on several machines: PointIt's, or zenohd in PATH",
)
@click.option(
    "--secured",
    is_flag=True,
    help="use a router with certificates, encryption and access rules, made for this test",
)
@click.option(
    "--hosts",
    type=LoadCounts(MAX_HOSTS),
    metavar="N[,N]",
    help="number of hosts to spread people over, each a network namespace; several are measured in turn",
)
@click.option(
    "--routers",
    type=click.IntRange(1, MAX_ROUTERS),
    show_default="one for each host",
    help="number of routers with --hosts; with more than hosts, the others are above them, as in a building",
)
@click.option(
    "--fan",
    type=click.IntRange(1, MAX_ROUTERS),
    default=MAX_ROUTERS,
    show_default="all join the first",
    help="number of routers that join the same one; 1: a chain",
)
@click.option(
    "--central",
    is_flag=True,
    help="with --hosts: one pui and one selector at the first host, instead of some at each, to compare",
)
@click.option(
    "--sweep", is_flag=True, help="find the largest number of people with p99 of at most 50 ms and no drops"
)
@json_option
def command(
    *,
    users: tuple[int, ...],
    rate_hz: float,
    duration_s: float,
    layout: Layout,
    shards: int,
    router: Program | None,
    secured: bool,
    hosts: tuple[int, ...] | None,
    routers: int | None,
    fan: int,
    central: bool,
    sweep: bool,
    as_json: bool,
    site: str,
    connect: tuple[str, ...],
) -> int:
    """Drive the wrists of N people and measure latency, drops, CPU and memory.

    Each sample passes the real pipeline: pointing makes a ray, pui a cursor, selector a hover, led-driver
    light. The test starts a site of its own (scenario_3, without simulated people); with --connect or
    --credentials, people join the site that runs there, whose own processes are not measured. The exit code
    is 0 if the load was carried: p99 from wrist to light at most 50 ms, no drops; else 1. The load average
    includes other work on the machine.

    With --hosts, people and all that computes for them are at hosts of their own, each with a router. The
    shared services are at the first host. What crosses each link is counted. Several measurements give
    slopes: CPU and memory for each person and each host with 95 % intervals, and from them the number of
    people per core.

    Example: pointit load --users 40 --layout users; for the maximum: pointit load --sweep --duration 5;
    for slopes: sudo pointit load --hosts 1,2 --users 4,8,16 --router zenohd
    """
    quiet()
    context = click.get_current_context()
    credentials = given_credentials()
    is_default = context.get_parameter_source("connect") is ParameterSource.DEFAULT
    is_own = credentials is None and is_default
    if credentials is not None:
        os.environ[CREDENTIALS] = str(credentials.folder)  # for the processes

    # Options that need a site of its own contradict those of a running one.
    if secured and not is_own:
        raise ConfigError(
            "--secured makes a site of its own; leave it out with --connect or --credentials, where the site "
            "that runs there is secured or not"
        )
    is_free_to_spread = is_own and layout == "one"
    if hosts and not is_free_to_spread:
        raise ConfigError(
            "--hosts makes a site and processes of its own; leave out --layout, --connect and --credentials"
        )
    if is_own:  # its services must not store their state among that of this machine's user
        folder = tempfile.TemporaryDirectory(prefix="pointit-load-")
        os.environ[VARIABLE] = context.with_resource(folder)

    # One load for each number of hosts: 0 simulates none.
    loads: list[LoadParameters] = []
    endpoints = () if is_own else connect
    for host_count in hosts or (0,):
        needs_router = secured or host_count > 0
        default_router: Program | None = "pointit" if needs_router else None
        own_router = router or default_router
        own_routers = routers or host_count
        load = LoadParameters(
            rate_hz=rate_hz,
            duration_s=duration_s,
            layout=layout,
            shards=shards,
            router=own_router,
            secured=secured,
            site=site,
            connect=endpoints,
            hosts=host_count,
            routers=own_routers,
            fan=fan,
            central=central,
        )
        loads.append(load)

    # `_run` appends each result, so an interrupted test still prints those before it.
    results: list[LoadResult] = []
    searches: list[CapacitySearch] = []
    running = _run(loads, users, results, searches if sweep else None)
    code = run_until_shutdown(running)
    if not results:
        return INTERRUPTED

    if as_json:
        print_json(_document(results, searches))
    else:
        show(_sections(results, slopes(results)), as_json=False)
        for load, search in zip(loads, searches, strict=False):
            click.echo(f"carried: {search.carried} people at {rate_hz:g} Hz, {load.name}")
    return code or _exit_code(results, searches)


def _document(results: Sequence[LoadResult], searches: Sequence[CapacitySearch]) -> dict[str, Any]:
    measured = [result.record() for result in results]
    part_slopes = [part.record() for part in slopes(results)]
    document: dict[str, Any] = {"measured": measured, "slopes": part_slopes}
    if searches:
        document["limit"] = searches[-1].carried
    return document


def _exit_code(results: Sequence[LoadResult], searches: Sequence[CapacitySearch]) -> int:
    # A sweep ends with a load that fails. It has failed only if it carried nobody.
    if searches:
        is_carried = all(search.carried for search in searches)
    else:
        is_carried = not any(result.failure for result in results)
    return 0 if is_carried else EXIT_FAILED


def _sections(results: Sequence[LoadResult], slopes: Sequence[PartSlopes]) -> list[OutputSection]:
    first = results[0]
    about = f"{first.rate_hz:g} Hz each for {first.duration_s:g} s, {first.layout}"
    roomy = frozenset({"cursor_p50_ms", "cursor_p99_ms", "processes", "load", "busiest"})
    rows = tuple(result.row() for result in results)
    sections = [OutputSection(name="load", about=about, rows=rows, roomy=roomy)]

    # Processes and links would be too many rows: only those of the last measurement are shown.
    last = results[-1]
    if len(last.processes) > 1:
        about = f"CPU for one sample of all, {last.users} people, {last.layout}"
        rows = tuple(last.process_rows())
        sections.append(OutputSection(name="processes", about=about, rows=rows))
    if last.links:
        about = f"per second, {last.users} people, {last.layout}"
        rows = tuple(last.link_rows())
        roomy = frozenset({"up", "down"})
        sections.append(OutputSection(name="links", about=about, rows=rows, roomy=roomy))

    if slopes:
        rows = tuple(part.row() for part in slopes)
        sections.append(OutputSection(name="slopes", about="with 95 % intervals", rows=rows))
    return sections


async def _run(
    loads: Sequence[LoadParameters],
    users: Sequence[int],
    results: list[LoadResult],
    searches: list[CapacitySearch] | None,
) -> int:
    for load in loads:
        search = None
        if searches is not None:
            search = CapacitySearch(FIRST, MAX_USERS)
            searches.append(search)
        counts = users if search is None else search.counts()
        for count in counts:
            load_text = f"{count} people at {load.rate_hz:g} Hz, {load.name}"
            _show_progress(f"{load_text}: starting …")
            result = await measure(load, count, _show_progress)
            results.append(result)
            _show_progress(f"  {_summary(result)}")

            # The next count of a search depends on this report.
            if search is not None:
                search.report(count, carried=not result.failure)
    return 0


def _summary(result: LoadResult) -> str:
    row = result.row()
    latency = f"p50 {row['light_p50_ms']} ms, p99 {row['light_p99_ms']} ms"
    drops = f"drops {row['drops_percent']} %"
    cpu = f"CPU {row['cpu_percent']} %"
    usage = f"{cpu}, {row['memory_mb']} MB, load {row['load']}"
    outcome = result.failure or "carried"
    return f"{latency}, {drops}, {usage}: {outcome}"


def _show_progress(text: str) -> None:
    click.echo(text, err=True)
