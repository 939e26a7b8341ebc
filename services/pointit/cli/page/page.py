"""`pointit page FILE`: the page with a recording and a timeline."""

import asyncio
import contextlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pointit.cli.common.progress import interruptible, progress
from pointit.cli.page import browser
from pointit.cli.page.run_page import browser_option, port_option
from pointit.launch.page.page import (
    Page,
    is_available,
    page_link_file,
    page_of,
    page_unavailable_error,
    where,
)
from pointit.launch.plan.settings import Settings
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.atomic_file import write_atomically
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.service.shutdown import run_until_shutdown
from pointit.schemas import NS_PER_S

if TYPE_CHECKING:
    from pointit.recording.reader import Recording

LINK = "recording"
"""Folder of the link's file, beside those of sites."""


@click.command("page")
@click.argument("file", type=click.Path(path_type=Path))
@port_option("--port")
@browser_option
@click.option(
    "--to",
    "output",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="HTML",
    help="write the page and the recording as one file instead, which plays without PointIt",
)
@click.option("--overwrite", is_flag=True, help="replace the file of --to if it exists")
def command(*, file: Path, port: int | None, no_browser: bool, output: Path | None, overwrite: bool) -> int:
    """Open the recording FILE in the page, with a timeline: play, pause, step, scrub.

    Prints the address of the page and serves it on this machine until Ctrl-C. Nothing in it can be changed.
    The file of --to opens in a browser from a disk or any web server.

    Example: pointit page lab.mcap
    """
    setup_logging("warning")
    if not is_available():
        raise page_unavailable_error("pointit page")
    # here, since the extra may be missing where help is asked for
    from pointit.recording.reader import Recording  # noqa: PLC0415

    asked: dict[str, Any] = {} if port is None else {"port": port}
    if output is not None and port is not None:
        raise click.UsageError("--port and --to exclude each other: --to writes a file, which needs no port")
    with Recording.open(file) as recording:
        if output is not None:
            return _write(recording, file, output, overwrite=overwrite)
        page = page_of(Settings(), asked=asked, option="--port")
        return run_until_shutdown(_serve(recording, file.name, page, is_open=not no_browser))


async def _serve(recording: "Recording", title: str, page: Page, *, is_open: bool) -> int:
    from pointit.bridges.web.playback.file_past import FilePast  # noqa: PLC0415
    from pointit.bridges.web.playback.server import RecordingServer  # noqa: PLC0415

    server = RecordingServer(FilePast(recording, title), page.config)
    await server.start()
    with contextlib.ExitStack() as stack:
        file = stack.enter_context(page_link_file(LINK, page.url))
        click.echo(f"page: {where(page.url, file, sys.stdout)}")
        if recording.problem:
            click.echo(f"note: {recording.problem}", err=True)
        if file is not None and is_open and browser.is_wanted():
            window = browser.BrowserWindow(file)
            stack.callback(window.close)
            window.open()
        await server.run()
    return 0


def _write(recording: "Recording", file: Path, output: Path, *, overwrite: bool) -> int:
    from pointit.bridges.web.playback.file_past import FilePast  # noqa: PLC0415
    from pointit.bridges.web.playback.page_file import page_file  # noqa: PLC0415

    if output.is_symlink() or (output.exists() and (not output.is_file() or output.samefile(file))):
        raise ConfigError(f"{output}: is the recording, or no plain file; give another file")
    if output.exists() and not overwrite:
        raise ConfigError(f"{output}: exists already; give another file, or --overwrite to replace it")
    if recording.problem:
        click.echo(f"note: {recording.problem}", err=True)
    past = FilePast(recording, file.stem)
    with interruptible(), progress(round((past.ended_ns - past.began_ns) / NS_PER_S)) as tell:
        asyncio.run(past.read())
        html = page_file(past, lambda at_s: tell("seconds", round(at_s))).encode()
    write_atomically(output, html, mode=0o644)
    click.echo(f"{output}: {len(html) / 1e6:.1f} MB, {past.timeline().length_s:.0f} s")
    return 0
