"""`pointit dashboard`: the page for a site that runs elsewhere."""

import contextlib
import sys
from typing import Any

import click

from pointit.cli.common.panels import PanelCommand
from pointit.cli.common.site_link import site_options
from pointit.cli.page import browser
from pointit.cli.page.run_page import NEW_LINK, browser_option, port_option
from pointit.launch.page.page import (
    EVERYWHERE,
    Page,
    is_available,
    page_link_file,
    page_of,
    page_unavailable_error,
    where,
)
from pointit.launch.page.page_tokens import stored_tokens
from pointit.launch.plan.settings import Settings
from pointit.launch.run.run_site import CLOCK_TIMEOUT_S
from pointit.launch.run.running_scenario import PRESENCE_TIMEOUT_S
from pointit.runtime.address_config import is_loopback
from pointit.runtime.bus.contract import list_present
from pointit.runtime.bus.site_clock import SiteClock
from pointit.runtime.config.network_address import parse_address
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import Link
from pointit.runtime.link.options import link_of
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.service.process import log_option
from pointit.runtime.service.service import check_launches, run_service
from pointit.runtime.service.shutdown import run_until_shutdown
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas.topics import SERVICE_ALIVE


@click.command(
    "dashboard",
    params=[*site_options(), log_option()],
    cls=PanelCommand,
    usual=("connect", "port", "lan", "no_browser", "view_only"),
)
@port_option("--port")
@click.option(
    "--host",
    default="",
    show_default=False,
    help="address to listen on  [default: localhost only; with --lan, all addresses]",
)
@click.option("--lan", is_flag=True, help="also open the page to the local network, by HTTPS")
@browser_option
@click.option("--new-link", is_flag=True, help=NEW_LINK)
@click.option("--view-only", is_flag=True, help="print only the link for viewing, not the one for control")
def command(
    *,
    port: int | None,
    host: str,
    lan: bool,
    no_browser: bool,
    new_link: bool,
    view_only: bool,
    site: str,
    connect: tuple[str, ...],
    log_level: str,
) -> int:
    """Open the page of a site that runs already: a `pointit run` on another machine, or on this one.

    Joins the site as soon as it is reachable, prints the address of the page, and serves it until Ctrl-C.
    The site continues when the page ends, and the page waits for the site when that ends.

    Example: pointit dashboard --connect tcp/plant.local:7447 --view-only
    """
    setup_logging("warning" if log_level == "info" else log_level)
    if not is_available():
        raise page_unavailable_error("pointit dashboard")
    asked = _asked(port, host, is_lan=lan)
    tokens, notes = stored_tokens(site, renew=new_link)
    for note in notes:
        click.echo(note, err=True)
    page = page_of(Settings(), asked=asked, tokens=tokens, option="--port")
    check_launches([page.launch()])
    return run_until_shutdown(
        _serve(page, link_of(site, connect), is_open=not no_browser, view_only=view_only)
    )


def _asked(port: int | None, address: str, *, is_lan: bool) -> dict[str, Any]:
    try:
        host, own_port = parse_address(address) if address else ("", None)
    except ValueError as error:
        raise ConfigError(f"--host: {error}") from error
    asked: dict[str, Any] = {} if port is None else {"port": port}
    if own_port is not None:
        name = "lan_port" if is_lan and not is_loopback(host) else "port"
        if asked.setdefault(name, own_port) != own_port:
            raise ConfigError(f"--host {address} and --port {port} differ: remove one of the ports")
    if is_lan:
        asked["lan"] = True
    if host and not is_loopback(host):
        if not is_lan:
            raise ConfigError(
                f"--host {address}: a page on a network needs HTTPS, or its token could be intercepted; "
                "use --lan, which enables it"
            )
        asked["lan_address"] = "" if host in EVERYWHERE else host
    elif host:
        asked["host"] = host
    return asked


async def _serve(page: Page, link: Link, *, is_open: bool, view_only: bool) -> int:
    """Serve the page as soon as the site is reachable, until cancelled."""
    bus = await ZenohBus.open(link)
    try:
        clock = SiteClock(bus)
        await clock.wait_for_tick(CLOCK_TIMEOUT_S)
        there = await list_present(bus, SERVICE_ALIVE, PRESENCE_TIMEOUT_S)
        launches = (page.launch(number) for number in range(1, len(there) + 2))
        launch = next(launch for launch in launches if launch.instance not in there)
        url = page.viewer_url if view_only else page.url
        lan_url = page.viewer_lan_url if view_only else page.lan_url
        with contextlib.ExitStack() as stack:
            file = stack.enter_context(page_link_file(bus.site, url, lan_url))
            click.echo(f"page: {where(url, file, sys.stdout)}")
            if lan_url:
                click.echo(f"for the local network: {where(lan_url, file, sys.stdout)}")
            if file is not None and is_open and browser.is_wanted():
                stack.callback(browser.PageOpener(bus, launch.instance, file).close)
            await run_service(launch, bus, clock)
    finally:
        await bus.close()
    return 0
