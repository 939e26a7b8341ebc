"""The page's link in a file that only its owner can read, since logs and command lines must not hold it.

Every user of a machine sees the arguments of all processes, so the browser is given this file instead of the
link. Without a terminal, the log names the file.
"""

from html import escape
from pathlib import Path
from urllib.parse import urlsplit

from pointit.runtime.host.atomic_file import write_atomically
from pointit.runtime.host.state_file import site_folder

ONWARDS = """<!doctype html><html lang="en"><meta charset="utf-8"><title>PointIt</title>
<meta http-equiv="refresh" content="0;url={first}">
{links}</html>
"""


def keep_link(site: str, *urls: str) -> Path:
    """Write a file that leads a browser to the first of `urls` and lists them all, and return its path.

    Raises:
        ConfigError: If it cannot be written; names the file.
    """
    path = site_folder(site, "web") / f"page-{urlsplit(urls[0]).port}.html"
    links = "".join(f'<p><a href="{escape(url)}">{escape(url)}</a></p>\n' for url in urls)
    write_atomically(path, ONWARDS.format(first=escape(urls[0]), links=links).encode())
    return path


def without_token(url: str) -> str:
    """Return the address of the page without the token, which is public."""
    return url.partition("?")[0]
