"""The page's link in a file that only its owner can read, since logs and command lines must not hold it.

Every user of a machine sees the arguments of all processes, so the browser is given this file instead of the
link. Without a terminal, the log names the file.

No core: it writes a file.
"""

import contextlib
import logging
from collections.abc import Generator
from html import escape
from pathlib import Path
from urllib.parse import urlsplit

from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import site_folder, write_atomically
from pointit.schemas.problems import UNWRITABLE

log = logging.getLogger(__name__)

ONWARDS = """<!doctype html><html lang="en"><meta charset="utf-8"><title>PointIt</title>
<meta http-equiv="refresh" content="0;url={first}">
{links}</html>
"""


def keep_link(site: str, *urls: str) -> Path:
    """Write a file that leads a browser to the first of `urls` and lists them all, and return its path.

    Raises:
        ConfigError: If it cannot be written; names the file.
    """
    port = urlsplit(urls[0]).port
    path = site_folder(site, "web") / f"page-{port}.html"
    links = "".join(f'<p><a href="{escape(url)}">{escape(url)}</a></p>\n' for url in urls)
    html = ONWARDS.format(first=escape(urls[0]), links=links)
    write_atomically(path, html.encode())
    return path


@contextlib.contextmanager
def announced_link(bus: ServiceBus, link: str) -> Generator[None]:
    """Keep `link` in a file until the end, and log its path: the token is secret, and no log may hold it.

    If it cannot be written, health warns.
    """
    try:
        path = keep_link(bus.site, link)
    except ConfigError as error:
        sentence = f"no page can be opened: the link cannot be saved ({error}); set operator_token"
        log.error("%s", sentence)  # noqa: TRY400 - a sentence
        bus.warn(UNWRITABLE, sentence, "link file")
        yield
        return
    log.info("who may control opens %s, a file that holds the link", path)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)


def without_token(url: str) -> str:
    """Return the address of the page without the token, which is public."""
    return url.partition("?")[0]
