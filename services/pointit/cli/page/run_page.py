"""The page of `pointit run`: its options, its link, and the browser that opens it."""

import contextlib
import dataclasses
import io
from collections.abc import Callable, Generator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import click

from pointit.cli.common.run_part import Added, RunPart
from pointit.cli.page import browser
from pointit.launch.page.page import (
    PORT,
    REMEDY,
    Page,
    is_asked_of_page,
    is_available,
    page_link_file,
    page_of,
    page_unavailable_error,
    where,
)
from pointit.launch.page.page_tokens import stored_tokens
from pointit.launch.plan.launches import PAGE, Choices
from pointit.launch.plan.plan import Beside
from pointit.launch.plan.scenario import Scenario
from pointit.launch.plan.scenario_catalog import places
from pointit.runtime.bus.contract import Bus
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch

F = TypeVar("F", bound=Callable[..., Any])

NEW_LINK = (
    "create new links of the page and revoke the old ones  [default: the site's stored links, so that an "
    "open page reconnects after a restart at the same port]"
)


def port_option(name: str, metavar: str | None = None) -> Callable[[F], F]:
    """Return the option for the page's port."""
    text = f"port of the page on this machine, 0: any free one  [default: {PORT} or the next free one]"
    return click.option(name, type=click.IntRange(0, 65535), metavar=metavar, help=text)


browser_option = click.option("--no-browser", is_flag=True, help="do not open the page in a browser")

SPEAKING = ("page", "phone")
"""Values of `--announce` for which the page speaks names."""

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

    def __init__(self, page: Page, *, opens_browser: bool = False) -> None:
        self.page = page
        self._opens_browser = opens_browser
        self._link: Path | None = None
        """The file that holds its link."""
        self._site_address = page.config.devices_at
        """Address at which processes of devices join."""

    @property
    def instance(self) -> str:
        """Return its instance name."""
        return self.page.instance

    def launch(self) -> Launch:
        """Return its launch. Slow: imports the server."""
        config = self.page.config.model_copy(update={"devices_at": self._site_address})
        return dataclasses.replace(self.page, config=config).launch()

    def checked(self) -> Sequence[Launch]:
        """Return it if parameters were set by hand."""
        return [] if self.page.is_usual else [self.launch()]

    @contextlib.contextmanager
    def joined(self, bus: Bus) -> Generator[None]:
        """Store the page's link in a file, and open the browser as soon as the page is present."""
        link: Link | None = getattr(bus, "link", None)  # that of Zenoh has one
        if link is not None and not self.page.scan_url:  # a scan drives its lights alone
            self._site_address = self._site_address or link.addresses[0]
        with contextlib.ExitStack() as stack:
            links = (self.page.scan_url, self.page.url, self.page.lan_url)
            self._link = stack.enter_context(page_link_file(bus.site, *filter(None, links)))
            if self._link is not None and self._opens_browser and browser.is_wanted():
                stack.callback(browser.PageOpener(bus, self.instance, self._link).close)
            yield

    def greeting(self, *, is_drawn: bool) -> Sequence[str]:
        """Return where it is, unless the view shows it, and where in the local network."""
        here = [] if is_drawn else [f"page: {where(self.page.url, self._link)}"]
        if self.page.scan_url:
            here += _scan_lines(self.page.scan_url, where(self.page.scan_url, self._link))
        if not self.page.lan_url:
            return here
        address = where(self.page.lan_url, self._link)
        return [*here, f"--lan: the page is open to the local network, at {address}"]

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


def _add(scenario: Scenario, choices: Choices, options: Mapping[str, Any]) -> Added:
    """Return the page of a run, if it has one. Raises ConfigError, or ListenError if its port is in use."""
    port: int | None = options["web_port"]
    asked = {"--web-port": port is not None, "--lan": options["lan"], "--new-link": options["new_link"]}
    if options["no_web"]:
        asked[f"--announce {options.get('announce')}"] = options.get("announce") in SPEAKING
        for option, is_given in asked.items():
            if is_given:
                raise ConfigError(f"--no-web and {option} exclude each other: there is no page")
        return Added()
    if not is_available():
        asked["--set web."] = is_asked_of_page(choices.settings)
        for option, is_given in asked.items():
            if is_given:
                raise page_unavailable_error(option)
        return Added(
            notes=[f"{REMEDY}; --no-web runs without it and without this note"],
            closing_note=f"There was no page: {REMEDY}.",
        )
    page_options: dict[str, Any] = {"port": port} if port is not None else {}
    if (announce := options.get("announce")) in SPEAKING:
        page_options["announce"] = announce
    tokens, notes = stored_tokens(options["site"], renew=options["new_link"])
    page = page_of(
        choices,
        below=scenario.site.get(PAGE, {}),
        asked=page_options | ({"lan": True} if options["lan"] else {}),
        places=places(scenario, choices),
        tokens=tokens,
    )
    if options["new_link"] and page.config.operator_token != tokens.operator:
        notes = (*notes, "--new-link does not change the link for control: its token is set by hand")
    config = page.config.model_copy(update={"run_output": page.config.run_output or choices.output})
    beside = RunPage(dataclasses.replace(page, config=config), opens_browser=not options["no_browser"])
    return Added(beside=[beside], services=[PAGE], notes=notes, moves_wrists=True)


PAGE_PART = RunPart(heading="Page", names=tuple(OPTIONS), options=_options, add=_add)
