"""The link of a page, from the file in which a run, a dashboard or the page's server keeps it."""

import asyncio
import html
import re
from pathlib import Path
from urllib.parse import urlsplit

from tests.support.pace import Patience

FILE = re.compile(r"(/\S+/page-\d+\.html)")
LINK = re.compile(r'href="([^"]+)"')


def link_in(printed: str) -> str:
    """Return the link in the last file named in `printed`."""
    path = Path(FILE.findall(printed)[-1])
    assert path.stat().st_mode & 0o077 == 0
    return html.unescape(LINK.findall(path.read_text(encoding="utf-8"))[0])


async def until_open(url: str) -> None:
    """Wait until the server at `url` accepts connections: a run prints its link before the page listens."""
    parts = urlsplit(url)
    patience = Patience(20)
    while True:
        try:
            _, writer = await asyncio.open_connection(parts.hostname, parts.port)
        except ConnectionRefusedError:
            assert not patience.is_over(), f"{url} does not listen within {patience}"
            await asyncio.sleep(0.1)
            continue
        writer.close()
        return
