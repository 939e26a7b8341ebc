"""`pointit router`: where several machines meet."""

import asyncio

import click

from pointit.runtime.log import setup_logging
from pointit.runtime.process import log_option, run_async
from pointit.runtime.router import routing
from pointit.runtime.zenoh_session import DEFAULT_ENDPOINT


@click.command("router", params=[log_option()])
@click.option(
    "--listen",
    multiple=True,
    default=(DEFAULT_ENDPOINT,),
    show_default=True,
    help="address to listen on; tcp/0.0.0.0:7447 lets other machines in",
)
def command(listen: tuple[str, ...], log_level: str) -> int:
    """Run a router, to which the processes of any number of sites connect.

    `pointit run` alone needs none. Anyone who reaches the address may join: other machines should reach it
    only through a trusted network.
    """
    setup_logging(log_level)
    return run_async(_route(listen))


async def _route(listen: tuple[str, ...]) -> int:
    async with routing(listen):
        click.echo(f"router listens on {', '.join(listen)}; Ctrl-C ends it")
        await asyncio.Event().wait()
    return 0
