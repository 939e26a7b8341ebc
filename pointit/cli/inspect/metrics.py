"""`pointit metrics`: metrics of a site for Prometheus."""

import asyncio
from typing import TYPE_CHECKING

import click

from pointit.cli.common.output import print_file
from pointit.cli.common.site_link import join_site, quiet, site_options
from pointit.commands import host_port
from pointit.launch.page import is_available, page_unavailable_error
from pointit.runtime.bus.contract import Bus
from pointit.runtime.host.extras import pointit_version
from pointit.runtime.service.process import EXIT_FAILED, run_until_shutdown
from pointit.site.following import follow_site

if TYPE_CHECKING:
    from pointit.bridges.web.site_metrics import SiteMetrics

LISTEN_S = 2.2
"""Listening time of `--once`, s: two reports of each service."""


@click.command("metrics", params=site_options())
@click.option(
    "--listen",
    metavar="HOST:PORT",
    callback=host_port,
    default="127.0.0.1:9464",
    help="loopback address to serve at; port 0: any free one",
)
@click.option("--once", is_flag=True, help="print the metrics instead, after two seconds")
def command(*, listen: tuple[str, int], once: bool, site: str, connect: tuple[str, ...]) -> int:
    """Serve metrics of a site to Prometheus, at http://127.0.0.1:9464/metrics until Ctrl-C.

    Rates, latencies, losses, services, people, selections, uncertainty of poses. Services always report these
    figures. Only this machine can read them. The page of a site has the same at /metrics, for clients with
    its token. Counters start with this command. With --once the exit code is 1 if no service runs.

    Example: pointit metrics --once
    """
    quiet()
    if not is_available():
        raise page_unavailable_error("pointit metrics")
    # here, since the extra may be missing where help is asked for
    from pointit.bridges.web.site_metrics import SiteMetrics  # noqa: PLC0415

    metrics = SiteMetrics(site, pointit_version())
    if once:
        return run_until_shutdown(_print(metrics, site, connect))
    host, port = listen
    return run_until_shutdown(_serve(metrics, host, port, site, connect))


def _attach(bus: Bus, metrics: "SiteMetrics") -> None:
    from pointit.bridges.web.site_metrics import READS  # noqa: PLC0415

    follow_site(metrics.state, bus, asyncio.get_running_loop().time, READS)


async def _print(metrics: "SiteMetrics", site: str, connect: tuple[str, ...]) -> int:
    from pointit.bridges.web.server.metrics_server import TEXT, exposition  # noqa: PLC0415

    async with join_site(site, connect) as bus:
        _attach(bus, metrics)
        await asyncio.sleep(LISTEN_S)
    content, _ = exposition(metrics, TEXT)
    print_file(content.decode())
    return EXIT_FAILED if metrics.is_empty else 0


async def _serve(metrics: "SiteMetrics", host: str, port: int, site: str, connect: tuple[str, ...]) -> int:
    from pointit.bridges.web.server.listener import url  # noqa: PLC0415
    from pointit.bridges.web.server.metrics_server import PATH, MetricsServer  # noqa: PLC0415

    server = MetricsServer(metrics, host, port)  # a wrong address is refused before the site is looked for
    async with join_site(site, connect) as bus:
        _attach(bus, metrics)
        address = url("http", host, server.port)
        click.echo(f"metrics: {address}{PATH}; Ctrl-C ends it")
        await server.run()
    return 0
