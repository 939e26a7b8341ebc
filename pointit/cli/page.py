"""The page from the command line: of a run, of a site elsewhere, of a recording."""

import asyncio
import contextlib
import dataclasses
import io
import logging
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import click

from pointit.cli.common.output import interruptible, progress
from pointit.cli.common.panels import PanelCommand
from pointit.cli.common.site_link import site_options
from pointit.cli.parts import RunAddition, RunPart
from pointit.launch.page import (
    EVERYWHERE,
    PORT,
    REMEDY,
    Page,
    is_asked_of_page,
    is_available,
    is_listening,
    lan_lines,
    page_link_file,
    page_of,
    page_unavailable_error,
    stored_tokens,
    where,
)
from pointit.launch.plan.launches import PAGE, Choices, Settings
from pointit.launch.plan.plan import Beside, Scenario
from pointit.launch.plan.scenario_catalog import places
from pointit.launch.run.run_site import CLOCK_TIMEOUT_S
from pointit.launch.run.running_scenario import PRESENCE_TIMEOUT_S
from pointit.runtime.address_config import is_loopback, parse_address
from pointit.runtime.bus.contract import Bus, list_present
from pointit.runtime.bus.site_clock import SiteClock
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import write_atomically
from pointit.runtime.host.windows_subsystem import lan_advice
from pointit.runtime.link.link import Link
from pointit.runtime.link.options import link_of
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.service.process import log_options, run_until_shutdown
from pointit.runtime.service.service import Launch, check_launches, run_service
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import NS_PER_S
from pointit.schemas.topics import SERVICE_ALIVE

if TYPE_CHECKING:
    from pointit.recording.reader import Recording
from pointit.cli.browser_window import BrowserWindow, PageOpener, PagePresence, is_wanted

log = logging.getLogger(__name__)

F = TypeVar("F", bound=Callable[..., Any])

NEW_LINK = (
    "create new links of the page and revoke the old ones  [default: the site's stored links, so that an "
    "open page reconnects after a restart at the same port]"
)

browser_option = click.option("--no-browser", is_flag=True, help="do not open the page in a browser")

SPEAKING = ("page", "phone")
"""Values of `--announce` for which the page speaks names."""

LINK = "recording"
"""Folder of the link's file, beside those of sites."""


def port_option(name: str, metavar: str | None = None) -> Callable[[F], F]:
    """Return the option for the page's port."""
    text = f"port of the page on this machine, 0: any free one  [default: {PORT} or the next free one]"
    return click.option(name, type=click.IntRange(0, 65535), metavar=metavar, help=text)


OPTIONS: dict[str, Callable[[Any], Any]] = {
    "no_web": click.option("--no-web", is_flag=True, help="no page for browsers"),
    "web_port": port_option("--web-port", metavar="PORT"),
    "lan": click.option(
        "--lan", is_flag=True, help="also open the page to the local network, by HTTPS, which phones need"
    ),
    "no_browser": browser_option,
    "new_link": click.option("--new-link", is_flag=True, help=NEW_LINK),
}


class RunPage(Beside):
    """The page beside a run."""

    WHAT: ClassVar[str] = "page"
    ONE_IS_ENOUGH: ClassVar[bool] = True

    def __init__(self, page: Page, *, opens_browser: bool = False, has_processes: bool = False) -> None:
        """Create it. `has_processes`: every service of the run has a process of its own."""
        self.page = page
        self._has_processes = has_processes
        self._opens_browser = opens_browser
        self._link: Path | None = None
        """The file that holds its link."""
        self._site_address = page.config.devices_at
        """Address at which processes of devices join."""
        self._has_own_process = False
        self._lan_advice = ""

    @property
    def instance(self) -> str:
        """Return its instance name."""
        return self.page.instance

    def needs_own_process(self, link: Link) -> bool:
        """Return True if others may open it, as on a secured site, or every service has a process."""
        if self.page.is_open_to_others or self._has_processes:
            return True
        return link.credentials is not None

    def launch(self) -> Launch:
        """Return its launch. Slow, unless it has a process of its own: imports the server."""
        if self.page.lan_url:
            self._lan_advice = lan_advice(self.page.config.lan_port)
        config = self.page.config.model_copy(update={"devices_at": self._site_address})
        page = dataclasses.replace(self.page, config=config)
        if self._has_own_process:
            return page.process_launch()
        return page.launch_in_run()

    def checked(self) -> Sequence[Launch]:
        """Return it if parameters were set by hand."""
        return [] if self.page.is_usual else [self.page.launch()]

    @contextlib.contextmanager
    def joined(self, bus: Bus) -> Generator[None]:
        """Store the page's link in a file, and open the browser as soon as the page is present."""
        link: Link | None = getattr(bus, "link", None)  # that of Zenoh has one
        self._has_own_process = link is not None and self.needs_own_process(link)
        if link is not None and not self.page.scan_url:  # a scan drives its lights alone
            self._site_address = self._site_address or link.addresses[0]
        with contextlib.ExitStack() as stack:
            links = (self.page.scan_url, self.page.url, self.page.lan_url)
            link_file = page_link_file(bus.site, *filter(None, links))
            self._link = stack.enter_context(link_file)
            opens_browser = self._opens_browser and is_wanted()
            if self._link is not None and opens_browser:
                stack.callback(PageOpener(bus, self.instance, self._link).close)
            yield

    def greeting(self, *, is_drawn: bool) -> Sequence[str]:
        """Return where it is, unless the view shows it, and where in the local network."""
        lines: list[str] = []
        if not is_drawn:
            address = where(self.page.url, self._link)
            lines.append(f"page: {address}")
        is_scan_open = self.page.scan_url.startswith("http:") or is_listening(self.page.scan_url)
        if self.page.scan_url and is_scan_open:
            address = where(self.page.scan_url, self._link)
            lines += _scan_lines(self.page.scan_url, address)
        lines += lan_lines(self.page.lan_url, self._link, self._lan_advice)
        return lines

    @property
    def address(self) -> str:
        """Return its URL."""
        return self.page.url


def _scan_lines(url: str, shown: str) -> list[str]:
    """Return where the room is mapped; on a terminal also as a QR code for a phone."""
    lines = [f"map this room: open {shown}"]
    if shown == url and url.startswith("https:"):
        import segno  # noqa: PLC0415 - of the page's extra

        drawn = io.StringIO()
        segno.make(url, error="l", micro=False).terminal(out=drawn, compact=True)
        lines += ["with the phone, in the same network: scan this code", *drawn.getvalue().splitlines()]
    return lines


def _options(function: Any) -> Any:
    for option in reversed(OPTIONS.values()):
        function = option(function)
    return function


def _add(scenario: Scenario, choices: Choices, options: Mapping[str, Any]) -> RunAddition:
    """Return the page of a run, if it has one. Raises ConfigError, or ListenError if its port is in use."""
    port: int | None = options["web_port"]
    announce = options.get("announce")

    # Without a page, options of it are errors rather than without effect
    page_options = {
        "--web-port": port is not None,
        "--lan": options["lan"],
        "--new-link": options["new_link"],
    }
    if options["no_web"]:
        page_options[f"--announce {announce}"] = announce in SPEAKING
        for option in _given(page_options):
            raise ConfigError(f"--no-web and {option} exclude each other: there is no page")
        return RunAddition()
    if not is_available():
        page_options["--set web."] = is_asked_of_page(choices.settings)
        for option in _given(page_options):
            raise page_unavailable_error(option)
        return RunAddition(
            notes=[f"{REMEDY}; --no-web runs without it and without this note"],
            closing_note=f"There was no page: {REMEDY}.",
        )

    # What the options set wins over the scenario, and loses to --set
    settings: dict[str, Any] = {}
    if port is not None:
        settings["port"] = port
    if announce in SPEAKING:
        settings |= {"announce": announce, "language": options.get("language") or ""}
    if options["lan"]:
        settings["lan"] = True
    tokens, notes = stored_tokens(options["site"], renew=options["new_link"])
    page = page_of(
        choices,
        below=scenario.site.get(PAGE, {}),
        asked=settings,
        places=places(scenario, choices),
        tokens=tokens,
    )
    if options["new_link"] and page.config.operator_token != tokens.operator:
        notes = (*notes, "--new-link does not change the link for control: its token is set by hand")

    # A light that the page would connect waits if the run drives it
    run_output = page.config.run_output or choices.output
    config = page.config.model_copy(update={"run_output": run_output})
    beside = RunPage(
        dataclasses.replace(page, config=config),
        opens_browser=not options["no_browser"],
        has_processes=bool(options.get("processes")),
    )
    return RunAddition(beside=[beside], services=[PAGE], notes=notes, moves_wrists=True)


def _given(options: Mapping[str, bool]) -> list[str]:
    return [option for option, is_given in options.items() if is_given]


PAGE_PART = RunPart(heading="Page", names=tuple(OPTIONS), options=_options, add=_add)


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
    from pointit.bridges.web.playback.past_page import RecordingServer  # noqa: PLC0415

    server = RecordingServer(FilePast(recording, title), page.config)
    await server.start()
    with contextlib.ExitStack() as stack:
        file = stack.enter_context(page_link_file(LINK, page.url))
        address = where(page.url, file, sys.stdout)
        click.echo(f"page: {address}")
        if recording.problem:
            click.echo(f"note: {recording.problem}", err=True)
        opens_browser = is_open and is_wanted()
        if file is not None and opens_browser:
            window = BrowserWindow(file)
            stack.callback(window.close)
            window.open()
        await server.run()
    return 0


def _write(recording: "Recording", file: Path, output: Path, *, overwrite: bool) -> int:
    from pointit.bridges.web.playback.file_past import FilePast  # noqa: PLC0415
    from pointit.bridges.web.playback.page_file import page_file  # noqa: PLC0415

    if not _is_replaceable(output, file):
        raise ConfigError(f"{output}: is the recording, or no plain file; give another file")
    if output.exists() and not overwrite:
        raise ConfigError(f"{output}: exists already; give another file, or --overwrite to replace it")
    if recording.problem:
        click.echo(f"note: {recording.problem}", err=True)
    past = FilePast(recording, file.stem)
    duration_s = (past.ended_ns - past.began_ns) / NS_PER_S
    with interruptible(), progress(round(duration_s)) as tell:
        asyncio.run(past.read())
        html = page_file(past, lambda at_s: tell("seconds", round(at_s))).encode()
    write_atomically(output, html, mode=0o644)
    size_mb = len(html) / 1e6
    length_s = past.timeline().length_s
    click.echo(f"{output}: {size_mb:.1f} MB, {length_s:.0f} s")
    return 0


def _is_replaceable(output: Path, recording: Path) -> bool:
    """Return True if `output` is free, or a plain file other than the recording."""
    if output.is_symlink():
        return False
    if not output.exists():
        return True
    return output.is_file() and not output.samefile(recording)


@click.command(
    "dashboard",
    params=[*site_options(), *log_options()],
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
def dashboard(
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
    """Open the page of a site that is already running, on this machine or another one.

    Joins the site as soon as it is reachable, prints the address of the page, and serves it until Ctrl-C.
    The site continues when the page ends, and the page waits for the site when that ends.

    Example: pointit dashboard --connect tcp/plant.local:7447 --view-only
    """
    setup_logging("warning" if log_level == "info" else log_level)
    if not is_available():
        raise page_unavailable_error("pointit dashboard")
    settings = _port_settings(port, host, is_lan=lan)
    tokens, notes = stored_tokens(site, renew=new_link)
    for note in notes:
        click.echo(note, err=True)

    # Errors of its parameters are found before it waits for the site
    page = page_of(Settings(), asked=settings, tokens=tokens, option="--port")
    check_launches([page.launch()])
    link = link_of(site, connect)
    return run_until_shutdown(_serve_dashboard(page, link, is_open=not no_browser, view_only=view_only))


def _port_settings(port: int | None, address: str, *, is_lan: bool) -> dict[str, Any]:
    try:
        host, own_port = parse_address(address) if address else ("", None)
    except ValueError as error:
        raise ConfigError(f"--host: {error}") from error

    # The port of an address in the network is that of HTTPS
    settings: dict[str, Any] = {}
    if port is not None:
        settings["port"] = port
    if own_port is not None:
        is_of_lan = is_lan and not is_loopback(host)
        name = "lan_port" if is_of_lan else "port"
        if settings.setdefault(name, own_port) != own_port:
            raise ConfigError(f"--host {address} and --port {port} differ: remove one of the ports")
    if is_lan:
        settings["lan"] = True
    if host and not is_loopback(host):
        if not is_lan:
            raise ConfigError(
                f"--host {address}: a page on a network needs HTTPS, or its token could be intercepted; "
                "use --lan, which enables it"
            )
        settings["lan_address"] = "" if host in EVERYWHERE else host
    elif host:
        settings["host"] = host
    return settings


@dataclasses.dataclass(frozen=True, kw_only=True)
class DashboardLines:
    """Addresses of a dashboard, to be printed once it is present."""

    url: str
    lan_url: str
    """`""` if it is not open to the local network."""
    file: Path | None
    """File with the links, or None."""
    lan_advice: str
    """See `windows_subsystem.lan_advice`."""

    def print(self) -> None:
        """Print those at which it listens."""
        click.echo(f"page: {where(self.url, self.file, sys.stdout)}")
        for line in lan_lines(self.lan_url, self.file, self.lan_advice, sys.stdout):
            click.echo(line)


async def _serve_dashboard(page: Page, link: Link, *, is_open: bool, view_only: bool) -> int:
    """Serve the page as soon as the site is reachable, until cancelled."""
    bus = await ZenohBus.open(link)
    try:
        clock = SiteClock(bus)
        await clock.wait_for_tick(CLOCK_TIMEOUT_S)
        present = await list_present(bus, SERVICE_ALIVE, PRESENCE_TIMEOUT_S)

        # A site may have several pages: the first number that is free
        number = 1
        launch = page.launch(number)
        while launch.instance in present:
            number += 1
            launch = page.launch(number)

        url = page.viewer_url if view_only else page.url
        lan_url = page.viewer_lan_url if view_only else page.lan_url
        with contextlib.ExitStack() as stack:
            file = stack.enter_context(page_link_file(bus.site, url, lan_url))
            advice = await asyncio.to_thread(lan_advice, page.config.lan_port) if lan_url else ""
            lines = DashboardLines(url=url, lan_url=lan_url, file=file, lan_advice=advice)
            stack.callback(PagePresence(bus, launch.instance, lines.print).close)
            opens_browser = is_open and is_wanted()
            if file is not None and opens_browser:
                stack.callback(PageOpener(bus, launch.instance, file).close)
            await run_service(launch, bus, clock)
    finally:
        await bus.close()
    return 0
