"""The page and a recording in one HTML file, which plays without a server, from a disk too."""

import base64
import itertools
import json
import re
import zlib
from collections.abc import Callable, Iterator
from urllib.parse import quote

from pointit.bridges.web.pages.latest_values import Change
from pointit.bridges.web.playback.playback import Playback
from pointit.bridges.web.playback.recent import Past
from pointit.bridges.web.server.bundle import STATIC
from pointit.bridges.web.wire import Hello
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import pointit_version
from pointit.schemas import NS_PER_S, pack
from pointit.schemas.text import round_beyond

Frame = tuple[float, tuple[Change, ...], tuple[Change, ...], str]
"""Time from the beginning, s; states and events as in a batch; status as JSON once a second, else empty."""

RATE_HZ = 30
"""Frames of a recorded second, Hz."""

UNPACED_HZ = 1e9
"""Rate of a feed that never waits, Hz."""

MAX_BYTES = 24 * 1024 * 1024
"""Maximum size of the compressed recording."""

MODULE = re.compile(r'"\./(chunk-\w+\.js)"')
"""Import of another module of the page."""

PLAIN = "".join(set(map(chr, range(32, 127))) - set("%#<"))
"""Characters of a module that its address has as they are."""

LONGEST_S = 7200.0
"""Longest recording: each second has `RATE_HZ` frames, whether anything was recorded then or not."""


def page_file(past: Past, tick: Callable[[float], None] = lambda _: None, start_s: float = 0.0) -> str:
    """Return the HTML of the page with `past`, which has been read.

    `tick` gets the time of each finished frame, s from the beginning; the page begins to play at `start_s`.

    Raises:
        ConfigError: If it is too long for a page.
    """
    timeline = past.timeline()
    if timeline.length_s > LONGEST_S:
        length = round_beyond(timeline.length_s, LONGEST_S, 0)
        raise ConfigError(
            f"{timeline.title}: {length} s from its first to its last message are too long for "
            f"a page (limit {LONGEST_S:.0f} s, a clock may have leapt); record a shorter session"
        )

    # Greeting, timeline and frames, as a server sends them
    hello = Hello(version=pointit_version(), site=past.site, role="viewer", requests=(), deeds=())
    packer = zlib.compressobj(9, wbits=31)
    packed = bytearray()
    for part in (hello.model_dump_json(), timeline.model_dump_json(), *frames(past)):
        packed += packer.compress(pack(part))
        if isinstance(part, tuple):
            time_s = part[0]
            tick(time_s)
            if len(packed) > MAX_BYTES:
                raise ConfigError(
                    f"{timeline.title}: too long for a page: its limit of {MAX_BYTES >> 20} MB is "
                    f"reached after {time_s:.0f} s. Record a shorter session (pointit record --duration)."
                )
    packed += packer.flush()
    return _html(bytes(packed), start_s)


def frames(past: Past) -> Iterator[Frame]:
    """Yield what a server sends to a page that plays `past` from its beginning to its end."""
    playback = Playback(past, 0.0)
    feed = playback.model.cache.open(UNPACED_HZ)
    playback.play(0.0, is_playing=True)
    for number in itertools.count():
        now_s = number / RATE_HZ
        playback.advance(now_s)
        at_s = (playback.at_ns(now_s) - past.began_ns) / NS_PER_S
        status = "" if number % RATE_HZ else playback.status().model_dump_json()
        batch = feed.take(now_s)
        if batch is None:
            yield at_s, (), (), status
        else:
            feed.ack(batch.n)
            yield at_s, batch.states, batch.events, status
        if not playback.is_playing:
            return


def _html(recording: bytes, start_s: float) -> str:
    """Return the page with everything that it loads, and `recording`, packed."""
    html = _text("index.html")
    icon = f"data:image/svg+xml,{quote(_text('icon.svg'))}"
    encoded = base64.b64encode(recording).decode()
    import_map = json.dumps({"imports": _modules()})
    content = (
        f'<script id="recording" type="text/plain" data-start-s="{start_s:g}">'
        f"{encoded}</script>"
        f'<script type="importmap">{import_map}</script>'
        '<script type="module">import "app.js";</script>\n'
        f'<script id="licences" type="text/plain">{_text("LICENSES.txt")}</script>\n</body>'
    )
    for address, replacement in (
        ('"/static/icon.svg"', f'"{icon}"'),
        ('<link rel="stylesheet" href="/static/app.css">', f"<style>{_text('app.css')}</style>"),
        ('<script type="module" src="/static/app.js"></script>\n', ""),
        ("</body>", content),
    ):
        assert html.count(address) == 1, address  # noqa: S101 - the built page is ours
        html = html.replace(address, replacement)
    return html


def _modules() -> dict[str, str]:
    """Return addresses of the page's modules, which contain them, by name.

    Modules of a page on a disk may not load other files.
    """
    modules: dict[str, str] = {}
    names = ["app.js"]
    for name in names:  # grows
        text = _text(name)
        imported = set(MODULE.findall(text))
        names += sorted(imported.difference(names))
        code = quote(MODULE.sub(r'"\1"', text), safe=PLAIN)
        modules[name] = f"data:text/javascript;charset=utf-8,{code}"
    return modules


def _text(name: str) -> str:
    return (STATIC / name).read_text(encoding="utf-8")
