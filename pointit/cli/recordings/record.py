"""`pointit record`: what travels on a site, in a file."""

import asyncio
import contextlib
import logging
from pathlib import Path
from typing import ClassVar

import click

from pointit.cli.common.panels import Finite, PanelCommand
from pointit.cli.common.site_link import join_site, site_options
from pointit.cli.recordings.run_recorder import recorder_launch, recorder_options
from pointit.runtime.bus.site_clock import SiteClock
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.options import given_credentials
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.service.process import CLOCK_TIMEOUT_S, EXIT_FAILED, run_until_shutdown
from pointit.runtime.service.service import Launch, check_launches, run_services
from pointit.services.recorder.service import Recorder

log = logging.getLogger(__name__)


class _CommandRecorder(Recorder):
    """A recorder that ends when nothing more can be written, and fails if it has heard nothing."""

    IS_COMMAND: ClassVar[bool] = True
    failed: ClassVar[bool] = False

    async def run(self) -> None:
        try:
            await super().run()
        finally:
            type(self).failed = bool(self.problem) or not self.has_received
            if not self.has_received:
                log.error(
                    "nothing of site %s is in the recording: name the right site with --site", self.bus.site
                )


@click.command(
    "record", params=site_options(), cls=PanelCommand, usual=("without", "pseudonyms", "duration", "connect")
)
@click.argument("file", required=False, type=click.Path(path_type=Path))
@recorder_options
@click.option("--duration", type=Finite(min=0.1), help="seconds until it ends by itself  [default: never]")
def command(
    file: Path | None,
    *,
    without: tuple[str, ...],
    pseudonyms: bool,
    duration: float | None,
    site: str,
    connect: tuple[str, ...],
) -> int:
    """Record all messages, requests, replies and presence of a site in FILE.

    FILE is an MCAP file, which Foxglove and Lichtblick can also open. Without FILE, it is
    pointit-SITE-TIME.mcap in the current folder. An existing file is not overwritten. Ctrl-C ends the
    recording. If it is killed, or the disk gets full, all but the last second remains readable.

    On a secured site, use the identity of a supervisor. The identity of a person records only their own
    movements. Other identities may not record. Exit code 1: the recording is incomplete, or no message of the
    site arrived.

    Example: pointit record session.mcap --without imu
    """
    setup_logging("info")
    credentials = given_credentials()
    if credentials is not None and credentials.is_observer:
        raise ConfigError(
            f"{credentials.description} may not announce a recorder, and nobody would see it record; "
            "record with the identity of a supervisor or of a person"
        )

    # A person may record their own movements only
    person = ""
    if credentials is not None and credentials.link.role == "user":
        person = credentials.link.name
    launch = recorder_launch(
        file,
        without=without,
        pseudonyms=pseudonyms,
        person=person,
        service=_CommandRecorder,
    )
    check_launches([launch])
    return run_until_shutdown(_record(launch, site, connect, duration))


async def _record(launch: Launch, site: str, connect: tuple[str, ...], duration_s: float | None) -> int:
    async with join_site(site, connect) as bus:
        clock = SiteClock(bus)
        await clock.wait_for_tick(CLOCK_TIMEOUT_S)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(duration_s):
                await run_services([launch], bus, clock)
    return EXIT_FAILED if _CommandRecorder.failed else 0
