"""`pointit load`: the number of people that this machine, or a running site, carries."""

import contextlib
import datetime as dt
import os
import socket
import tempfile
from collections.abc import AsyncGenerator, Generator, Sequence
from pathlib import Path

import click
from click.core import ParameterSource

from pointit.access.site_folder import SiteFolder
from pointit.access.site_state import SiteState
from pointit.cli.common.option_types import Finite
from pointit.cli.common.output import INTERRUPTED, Section, json_option, print_json, show
from pointit.cli.common.site_link import join_site, quiet, site_options
from pointit.cli.loadtest.figures import CapacitySearch, LoadResult
from pointit.cli.loadtest.layout import Layout, Load, groups
from pointit.cli.loadtest.rig import router_process, start_load_test
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import VARIABLE
from pointit.runtime.link.credentials import VARIABLE as CREDENTIALS
from pointit.runtime.link.credentials import Credentials, read_credentials
from pointit.runtime.link.link import Link
from pointit.runtime.link.options import given_credentials
from pointit.runtime.service.instance_takeover import claim_names
from pointit.runtime.service.shutdown import EXIT_FAILED, run_until_shutdown
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas.topics import USER_ALIVE

WARM_UP_S = 1.0
MAX_USERS = 1000
FIRST = 5
"""Number of people at the start of a sweep."""

NAME = "load"


@click.command("load", params=site_options())
@click.option(
    "--users", type=click.IntRange(1, MAX_USERS), default=10, show_default=True, help="number of people"
)
@click.option(
    "--rate",
    "rate_hz",
    type=Finite(min=1, max=1000),
    default=100.0,
    show_default=True,
    help="samples per second of each person",
)
@click.option(
    "--duration",
    "duration_s",
    type=Finite(min=0.5, max=86_400),
    default=10.0,
    show_default=True,
    help="measuring time, s",
)
@click.option(
    "--layout",
    type=click.Choice(["one", "users", "services"]),
    default="one",
    show_default=True,
    help="all in one process; people's services sharded over processes; one process per service",
)
@click.option(
    "--shards",
    type=click.IntRange(1, 256),
    default=os.cpu_count() or 1,
    show_default="the cores of this machine",
    help="number of processes for people with --layout users",
)
@click.option("--router", is_flag=True, help="connect processes by a router, as on several machines")
@click.option(
    "--secured",
    is_flag=True,
    help="use a router with certificates, encryption and access rules, made for this test",
)
@click.option(
    "--sweep", is_flag=True, help="find the largest number of people with p99 of at most 50 ms and no drops"
)
@json_option
def command(
    *,
    users: int,
    rate_hz: float,
    duration_s: float,
    layout: Layout,
    shards: int,
    router: bool,
    secured: bool,
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

    Example: pointit load --users 40 --layout users; for the maximum: pointit load --sweep --duration 5
    """
    quiet()
    context = click.get_current_context()
    credentials = given_credentials()
    is_own = credentials is None and context.get_parameter_source("connect") is ParameterSource.DEFAULT
    if credentials is not None:
        os.environ[CREDENTIALS] = str(credentials.folder)  # for the processes
    if secured and not is_own:
        raise ConfigError(
            "--secured makes a site of its own; leave it out with --connect or --credentials, where the site "
            "that runs there is secured or not"
        )
    if is_own:  # its services must not store their state among that of this machine's user
        os.environ[VARIABLE] = context.with_resource(tempfile.TemporaryDirectory(prefix="pointit-load-"))
    load = Load(
        users=users,
        rate_hz=rate_hz,
        duration_s=duration_s,
        layout=layout,
        shards=shards,
        router=router or secured,
        secured=secured,
        site=site,
        connect=() if is_own else connect,
    )
    done: list[LoadResult] = []
    search = CapacitySearch(FIRST, MAX_USERS) if sweep else None
    code = run_until_shutdown(_run(load, search, done))
    if not done:
        return INTERRUPTED
    if as_json:
        limit = {"limit": search.carried} if search is not None else {}
        print_json({"measured": [measured.record() for measured in done], **limit})
    else:
        show([_section(load, done)], as_json=False)
        if search is not None:
            click.echo(f"carried: {search.carried} people at {rate_hz:g} Hz, {load.name}")
    if code or search is not None:
        return code if search is None or search.carried else EXIT_FAILED
    return EXIT_FAILED if done[-1].failure else 0


def _section(load: Load, done: Sequence[LoadResult]) -> Section:
    about = f"{load.rate_hz:g} Hz each for {load.duration_s:g} s, {load.name}"
    return Section(
        name="load",
        about=about,
        rows=tuple(measured.row() for measured in done),
        roomy=frozenset({"cursor_p99_ms", "processes", "load", "busiest"}),
    )


async def _run(load: Load, search: CapacitySearch | None, done: list[LoadResult]) -> int:
    counts = [load.users] if search is None else search.counts()
    for count in counts:
        _tell(f"{count} people at {load.rate_hz:g} Hz, {load.name}: starting …")
        measured = await _measure(load, count)
        done.append(measured)
        row = measured.row()
        _tell(
            f"  p50 {row['light_p50_ms']} ms, p99 {row['light_p99_ms']} ms, drops {row['drops_percent']} %, "
            f"CPU {row['cpu_percent']} %, {row['memory_mb']} MB, load {row['load']}: "
            + (measured.failure or "carried")
        )
        if search is not None:
            search.report(count, carried=not measured.failure)
    return 0


async def _measure(load: Load, count: int) -> LoadResult:
    here, elsewhere = groups(load, count)
    async with _bus(load) as (bus, endpoint, router):
        if load.connect:
            users = [user for group in (here, *elsewhere) for user in group.wrists]
            await claim_names(bus, USER_ALIVE, users)
        async with start_load_test(bus, here, elsewhere, endpoint, router) as rig:
            await rig.measure(load.rate_hz, WARM_UP_S, load.name)
            _tell(f"  measuring for {load.duration_s:g} s …")
            return await rig.measure(load.rate_hz, load.duration_s, load.name)


@contextlib.asynccontextmanager
async def _bus(load: Load) -> AsyncGenerator[tuple[ZenohBus, str, int | None]]:
    """Yield this process's bus, the address for others, and the router's process id."""
    if load.connect:
        async with join_site(load.site, load.connect) as bus:
            yield bus, load.connect[0], None
        return
    async with contextlib.AsyncExitStack() as stack:
        port = _free_port()
        endpoint = f"tls/127.0.0.1:{port}" if load.secured else f"tcp/127.0.0.1:{port}"
        credentials, options = None, ["--listen", endpoint]
        if load.secured:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="pointit-load-site-"))
            credentials = secured_site(Path(folder), load.site, port)
            options = ["--site-folder", folder]
            stack.enter_context(_given(credentials))
        router = await stack.enter_async_context(router_process(options)) if load.router else None
        link = Link(
            site=load.site,
            connect=(endpoint,) if load.router else (),
            listen=(endpoint,) if not load.router and load.layout != "one" else (),
            credentials=credentials,
        )
        bus = await ZenohBus.open(link, patience_s=5.0)
        stack.push_async_callback(bus.close)
        yield bus, endpoint, router


@contextlib.contextmanager
def _given(credentials: Credentials) -> Generator[None]:
    """Give the processes of this test these credentials."""
    os.environ[CREDENTIALS] = str(credentials.folder)
    try:
        yield
    finally:
        del os.environ[CREDENTIALS]


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def _tell(text: str) -> None:
    click.echo(text, err=True)


def secured_site(folder: Path, site: str, port: int) -> Credentials:
    """Create the site in `folder` for a router on this machine. Return the credentials for all its processes.

    Raises:
        ConfigError: If `cryptography` is missing, or something cannot be written.
    """
    now = dt.datetime.now(dt.UTC)
    made = SiteFolder(folder)
    state = SiteState(
        site=site,
        hosts=("127.0.0.1",),
        port=port,
        days=1.0,
        password=False,
        dashboard_rate_hz=0.0,
        identities={},
    )
    made.create(state, {NAME: "supervisor"}, now)
    return read_credentials(made.identity_folder(NAME), now)
