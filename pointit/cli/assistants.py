"""`pointit mcp`: the site for assistants, by the Model Context Protocol."""

import contextlib
from typing import Literal

import click

from pointit.api.connection import connect as join
from pointit.cli.common.site_link import address, quiet, site_options
from pointit.commands import ConfigError, host_port, remedy, run_until_shutdown
from pointit.launch.page import FILE, TokenFile
from pointit.launch.plan.launches import PAGE
from pointit.runtime.host.extras import has_extra
from pointit.runtime.host.state_file import site_folder
from pointit.runtime.link.options import link_of

EXTRA = "mcp"


@click.command("mcp", params=site_options())
@click.option(
    "--listen",
    metavar="HOST:PORT",
    callback=host_port,
    help="serve streamable HTTP at this loopback address, such as 127.0.0.1:8096, with the page's tokens; "
    "port 0: any free one  [default: standard input and output]",
)
@click.option("--view-only", is_flag=True, help="allow only to look and to stop robots, whatever the token")
def command(*, listen: tuple[str, int] | None, view_only: bool, site: str, connect: tuple[str, ...]) -> int:
    """Connect an assistant, which can query pointing, light things and send robots (Model Context Protocol).

    The assistant's configuration starts this command, and they communicate by standard input and output. With
    --listen it serves assistants of this machine by HTTP until Ctrl-C. It waits for the site, reports when
    the connection is lost, and continues when it is back. All calls are in `pointit audit --assistants`.

    Example: pointit mcp --listen 127.0.0.1:8096 --view-only
    """
    quiet()
    if not has_extra(EXTRA):
        raise ConfigError(f"pointit mcp needs {remedy(EXTRA)}")
    link_of(site, connect)  # credentials of another site are refused before an assistant waits
    return run_until_shutdown(_serve(listen, "viewer" if view_only else "operator", site, connect))


async def _serve(
    listen: tuple[str, int] | None, role: Literal["operator", "viewer"], site: str, connect: tuple[str, ...]
) -> int:
    # here, since the extra may be missing where help is asked for
    from pointit.assistants.audit_file import FOLDER, AuditFile  # noqa: PLC0415
    from pointit.assistants.server import make_server  # noqa: PLC0415
    from pointit.assistants.site_connection import SiteConnection  # noqa: PLC0415
    from pointit.assistants.tools import Tools  # noqa: PLC0415

    connection = SiteConnection(lambda: join(connect, site=site, timeout_s=None), address(site, connect))
    audit = AuditFile(site_folder(site, FOLDER))
    server = make_server(Tools(connection, audit, role, is_remote=listen is not None))
    async with contextlib.AsyncExitStack() as stack:
        if listen is None:
            await stack.enter_async_context(connection.opened())
            await server.run_stdio_async()
            return 0
        from pointit.assistants.http_server import HttpServer  # noqa: PLC0415
        from pointit.bridges.web.server.access import Access  # noqa: PLC0415

        # a page that is started later may replace the tokens, and those of its links must be let in here
        token_file = TokenFile(site)
        tokens = token_file.current()
        access = Access(tokens.operator, tokens.viewer)

        def follow_tokens() -> None:
            present = token_file.current()
            access.change_tokens(present.operator, present.viewer)

        host, port = listen
        http = HttpServer(server, access, host, port, follow_tokens)
        for note in token_file.notes:
            click.echo(note, err=True)
        file = site_folder(site, PAGE) / FILE
        click.echo(f"{http.url}: tokens in {file}; Ctrl-C ends it")
        await stack.enter_async_context(connection.opened())
        await http.run()
    return 0
