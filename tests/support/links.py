"""The link of a page, from the file in which a run, a dashboard or the page's server keeps it."""

import html
import re
from pathlib import Path

FILE = re.compile(r"(/\S+/page-\d+\.html)")
LINK = re.compile(r'href="([^"]+)"')


def link_in(printed: str) -> str:
    """Return the link in the last file named in `printed`."""
    path = Path(FILE.findall(printed)[-1])
    assert path.stat().st_mode & 0o077 == 0
    return html.unescape(LINK.findall(path.read_text(encoding="utf-8"))[0])
