"""One measurement of a load test, from the start of its processes to their end."""

import contextlib
import datetime as dt
import os
import tempfile
from collections.abc import AsyncGenerator, Callable, Generator, Sequence
from pathlib import Path

from pointit.access.site_folder import SiteFolder, SiteFolderState
from pointit.cli.common.site_link import join_site
from pointit.runtime.link.link import VARIABLE as CREDENTIALS
from pointit.runtime.link.link import Credentials, Link, read_credentials
from pointit.runtime.service.instance_takeover import claim_names
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas.topics import USER_ALIVE
from pointit_lab.loadtest.hosts import start_hosts_test
from pointit_lab.loadtest.layout import LoadParameters, groups, host_groups
from pointit_lab.loadtest.load_result import LoadResult
from pointit_lab.loadtest.network.namespaces import PORT, free_port, network
from pointit_lab.loadtest.network.routers import plain_configuration, router_process, secured_configuration
from pointit_lab.loadtest.network.tree import tree
from pointit_lab.loadtest.rig import start_load_test

Tell = Callable[[str], None]

WARM_UP_S = 1.0

IDENTITY = "load"


async def measure(load: LoadParameters, count: int, tell: Tell) -> LoadResult:
    """Start `count` people with everything, measure, and end it all. `tell` gets progress."""
    if load.hosts:
        return await _measure_hosts(load, count, tell)
    here, remote_groups = groups(load, count)
    async with _bus(load) as (bus, endpoint, router):
        if load.connect:
            users = list(here.wrists)
            for group in remote_groups:
                users += group.wrists
            await claim_names(bus, USER_ALIVE, users)
        async with start_load_test(bus, here, remote_groups, endpoint, router) as rig:
            await rig.measure(load.rate_hz, WARM_UP_S, load.name)
            tell(f"  measuring for {load.duration_s:g} s …")
            return await rig.measure(load.rate_hz, load.duration_s, load.name)


async def _measure_hosts(load: LoadParameters, count: int, tell: Tell) -> LoadResult:
    machines = tree(load.hosts, load.routers, load.fan)
    with (
        tempfile.TemporaryDirectory(prefix="pointit-load-routers-") as folder,
        network(machines, "tls" if load.secured else "tcp") as host_network,
        contextlib.ExitStack() as stack,
    ):
        # Without the privilege for namespaces it measures nevertheless, all but the links.
        if host_network.lacking:
            tell(
                f"  hosts are processes on loopback, and their links are not measured "
                f"({host_network.lacking}); run as root, or by `unshare --map-root-user --net pointit load …`"
            )

        # The certificates name all addresses of the routers, so they come after the network.
        site: SiteFolder | None = None
        if load.secured:
            addresses = host_network.addresses()
            site_path = Path(folder) / "site"
            site, credentials = secured_site(site_path, load.site, PORT, addresses)
            stack.enter_context(_given(credentials))
        people = host_groups(load, count, machines)
        async with start_hosts_test(
            host_network,
            people,
            site=load.site,
            program=load.router or "pointit",
            folder=Path(folder),
            site_folder=site,
        ) as test:
            # The first samples meet links that have yet to learn who reads what: they are not measured.
            await test.until_carried(load.rate_hz, WARM_UP_S)
            tell(f"  measuring for {load.duration_s:g} s …")
            return await test.measure(load.rate_hz, load.duration_s, load.name)


@contextlib.asynccontextmanager
async def _bus(load: LoadParameters) -> AsyncGenerator[tuple[ZenohBus, str, int | None]]:
    """Yield this process's bus, the address for others, and the router's process id."""
    if load.connect:
        async with join_site(load.site, load.connect) as bus:
            yield bus, load.connect[0], None
        return
    async with contextlib.AsyncExitStack() as stack:
        port = free_port()
        scheme = "tls" if load.secured else "tcp"
        endpoint = f"{scheme}/127.0.0.1:{port}"

        # Processes meet at the router, else at this one, unless all are in this one.
        credentials = None
        router = None
        connect: tuple[str, ...] = ()
        listen: tuple[str, ...] = ()
        if load.router:
            connect = (endpoint,)
            temporary = tempfile.TemporaryDirectory(prefix="pointit-load-router-")
            folder = Path(stack.enter_context(temporary))
            configuration = plain_configuration(endpoint, ())
            if load.secured:
                site, credentials = secured_site(folder / "site", load.site, port, ["127.0.0.1"])
                configuration = secured_configuration(site, (), port)
                stack.enter_context(_given(credentials))
            process = router_process(configuration, load.router, folder)
            router = await stack.enter_async_context(process)
        elif load.layout != "one":
            listen = (endpoint,)

        link = Link(site=load.site, connect=connect, listen=listen, credentials=credentials)
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


def secured_site(
    folder: Path, site: str, port: int, addresses: Sequence[str]
) -> tuple[SiteFolder, Credentials]:
    """Create the site in `folder` for routers at `addresses`. Return it, and credentials for all processes.

    Raises:
        ConfigError: If `cryptography` is missing, or something cannot be written.
    """
    now = dt.datetime.now(dt.UTC)
    site_folder = SiteFolder(folder)
    state = SiteFolderState(
        site=site,
        hosts=tuple(addresses),
        port=port,
        days=1.0,
        password=False,
        dashboard_rate_hz=0.0,
        identities={},
    )
    site_folder.create(state, {IDENTITY: "supervisor"}, now)
    return site_folder, read_credentials(site_folder.identity_folder(IDENTITY), now)
