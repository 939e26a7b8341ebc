"""The window: the page in a browser, its errors, and the page coordinates of objects in the room."""

import asyncio
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray
from playwright.async_api import Browser, ConsoleMessage, Page, WebSocket, expect

from tests.support.pace import Patience

PATIENCE_S = 30.0
LEAST_PLACES = 10
MOST_OFF_PX = 12.0
VIOLATIONS = """
window.violations = [];
document.addEventListener('securitypolicyviolation',
  (event) => window.violations.push(`${event.violatedDirective}: ${event.blockedURI}`));
"""
FRAME_MS = 150
SELDOM = f"""
const draw = window.requestAnimationFrame.bind(window);
const asked = new Map();
window.requestAnimationFrame = (callback) => {{
  const id = setTimeout(() => asked.set(id, draw(callback)), {FRAME_MS});
  return id;
}};
const cancel = window.cancelAnimationFrame.bind(window);
window.cancelAnimationFrame = (id) => {{
  clearTimeout(id);
  cancel(asked.get(id) ?? 0);
}};
"""
"""Draws less often: without a graphics processor the scene takes all cores, which other tests need."""
COMPOSED = "GPU stall due to ReadPixels"
"""Chromium says so of every scene, since it composes pages without a graphics processor."""
NO_WEBGL = """
const context = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
  return kind.startsWith("webgl") ? null : context.call(this, kind, ...more);
};
"""
SHOWN = """() => {
  const { site, stats } = window.pointit ?? {};
  return Boolean(site && site.connected && site.map && site.status && stats && stats.fps > 0);
}"""
DRAWN_ANEW = """() => new Promise((done) => {
  setTimeout(() => requestAnimationFrame(() => requestAnimationFrame(done)), 1200);
})"""

Vec2 = tuple[float, float]
Vec3 = tuple[float, float, float]
Theme = Literal["light", "dark"]

expect.set_options(
    timeout=2 * PATIENCE_S * 1000
)  # the usual 5 s are little while all of a machine's cores are busy


@dataclass
class Window:
    page: Page
    faults: list[str] = field(default_factory=list[str])
    """Warnings and errors of the console, and requests to foreign hosts."""
    sent: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    """Messages of the page to its server, oldest first, without its acknowledgements."""
    latencies_ms: list[float] = field(default_factory=list[float])
    """From capture to frame, as its acknowledgements have it."""
    batches: list[bytes] = field(default_factory=list[bytes])
    """Kept while `keeps_batches`."""
    keeps_batches: bool = False

    @classmethod
    async def open(
        cls,
        browser: Browser,
        url: str,
        *,
        size: tuple[int, int] = (1280, 800),
        theme: Theme = "light",
        scripts: tuple[str, ...] = (),
        **context: Any,
    ) -> "Window":
        width, height = size
        opened = await browser.new_context(
            viewport={"width": width, "height": height}, color_scheme=theme, **context
        )
        window = cls(await opened.new_page())
        window._listen(urlsplit(url).netloc)
        for script in (VIOLATIONS, SELDOM, *scripts):
            await window.page.add_init_script(script)
        await window.page.goto(url)
        return window

    def _on_console(self, message: ConsoleMessage) -> None:
        if message.type == "error" or (message.type == "warning" and COMPOSED not in message.text):
            self.faults.append(f"{message.type}: {message.text}")

    def _listen(self, host: str) -> None:
        page = self.page
        page.on("pageerror", lambda error: self.faults.append(str(error)))
        page.on("console", self._on_console)
        page.on("requestfailed", lambda request: self.faults.append(f"failed: {request.url}"))
        page.on("request", lambda request: self._judge(request.url, host))
        page.on("websocket", lambda socket: self._overhear(socket, host))

    def _judge(self, url: str, host: str) -> None:
        parts = urlsplit(url)
        if parts.scheme not in ("data", "blob") and parts.netloc != host:
            self.faults.append(f"foreign: {url}")

    def _overhear(self, socket: WebSocket, host: str) -> None:
        self._judge(socket.url, host)
        socket.on("framesent", self._on_sent)
        socket.on("framereceived", self._on_received)

    def _on_sent(self, text: str | bytes) -> None:
        part = json.loads(text)
        if part["kind"] != "ack":
            self.sent.append(part)
        elif part["latency_ms"] is not None:
            self.latencies_ms.append(part["latency_ms"])

    def _on_received(self, message: str | bytes) -> None:
        if self.keeps_batches and isinstance(message, bytes):
            self.batches.append(message)

    async def is_shown(self, patience_s: float = PATIENCE_S) -> None:
        await self.until(SHOWN, "the site is shown", patience_s)

    async def is_still(self) -> None:
        """Wait until the camera stands still: cards, at which the page looks each second, make it move."""
        patience, before = Patience(PATIENCE_S), None
        while (lens := await self.page.evaluate("[...window.pointit.stats.lens]")) != before:
            assert not patience.is_over(), f"waited {patience} in vain: the camera moves"
            before = lens
            await self.is_drawn_anew()

    async def is_drawn_anew(self) -> None:
        """Wait until the page has looked at its cards, and has drawn what follows, however slow it is."""
        await self.page.evaluate(DRAWN_ANEW)

    async def until(self, condition: str, what: str = "", patience_s: float = PATIENCE_S) -> Any:
        """Wait until `condition`, JavaScript, is true, and return it.

        Playwright's own `wait_for_function` evaluates strings within the page, which its policy forbids.
        """
        patience = Patience(patience_s)
        while not (found := await self.page.evaluate(condition)):
            assert not patience.is_over(), f"waited {patience} in vain: {what or condition}"
            await asyncio.sleep(0.03)
        return found

    async def violations(self) -> list[str]:
        return list(await self.page.evaluate("window.violations"))

    async def objects(self) -> list[dict[str, Any]]:
        found = "[...window.pointit.site.objects.values()].flatMap(({ objects }) => objects)"
        return list(await self.page.evaluate(found))

    async def survey(self, settle_s: float = FRAME_MS / 1000) -> "Lens":
        """Move the mouse, which aims already, over the whole scene, and find the page coordinates of points.

        `settle_s` is the duration of the slowest frame.
        """
        box = await self.page.locator("#view canvas").bounding_box()
        assert box is not None
        places: list[tuple[Vec2, Vec3]] = []
        for down in (0.3, 0.45, 0.6, 0.75):
            for across in (0.15, 0.35, 0.5, 0.65, 0.85):
                x, y = box["x"] + across * box["width"], box["y"] + down * box["height"]
                if (at_m := await self.aimed_at(x, y, 2.0 + settle_s, settle_s)) is not None:
                    places.append(((x, y), at_m))
        return Lens.through(places)

    async def aimed_at(
        self, x: float, y: float, patience_s: float = 1.0, settle_s: float = 0.0
    ) -> Vec3 | None:
        """Move the mouse there, and return its aim, {W}, or None over something else."""
        self.sent.clear()
        await self.page.mouse.move(x, y)
        deadline_s = time.monotonic() + patience_s
        while time.monotonic() < deadline_s:
            if any(part["kind"] == "aim" for part in self.sent):
                await asyncio.sleep(settle_s)  # the first may belong to the mouse's former position
                aims = [part["at_m"] for part in self.sent if part["kind"] == "aim"]
                return (aims[-1][0], aims[-1][1], aims[-1][2])
            await asyncio.sleep(0.01)
        return None

    async def follows(self, lens: "Lens", kind: str, is_done: Callable[[], bool], patience_s: float) -> None:
        """Keep the mouse on an object of `kind` that is not selected until `is_done`; then on the next."""
        patience = Patience(patience_s)
        chosen = ""
        while not is_done():
            assert not patience.is_over(), f"{patience} of following {kind} ones in vain"
            taken = set(
                await self.page.evaluate("(window.pointit.site.selection?.objects ?? []).map(({ id }) => id)")
            )
            free = {each["id"]: each for each in await self.objects() if each["kind"] == kind}
            if chosen not in free or chosen in taken:
                chosen = next((name for name in free if name not in taken), "")
            if chosen:
                await self.page.mouse.move(*lens.to_page(free[chosen]["position_m"]))
            await asyncio.sleep(0.03)


@dataclass(frozen=True)
class Lens:
    """The projection of {W} on the page, estimated from points known in both."""

    projection: NDArray[np.float64]

    @classmethod
    def through(cls, places: list[tuple[Vec2, Vec3]]) -> "Lens":
        """Return the lens that sees each place where it is on the page, but for a few."""
        kept = list(places)
        while len(kept) >= LEAST_PLACES:
            lens = cls._fitted(kept)
            off_px = [float(np.hypot(*np.subtract(lens.to_page(at_m), at))) for at, at_m in kept]
            if max(off_px) < MOST_OFF_PX:
                return lens
            kept.pop(off_px.index(max(off_px)))  # aimed at before the mouse was there
        raise AssertionError(f"the scene is no picture of the room: {places}")

    @classmethod
    def _fitted(cls, places: list[tuple[Vec2, Vec3]]) -> "Lens":
        """Return the best fit (direct linear transformation)."""
        rows: list[list[float]] = []
        for (x, y), at_m in places:
            point = [*at_m, 1.0]
            u, v = x / 1000.0, y / 1000.0
            rows.append([*point, *([0.0] * 4), *(-u * value for value in point)])
            rows.append([*([0.0] * 4), *point, *(-v * value for value in point)])
        projection = np.linalg.svd(np.array(rows))[2][-1].reshape(3, 4)
        return cls(np.asarray(projection, dtype=np.float64))

    def to_page(self, at_m: Vec3) -> Vec2:
        u, v, w = self.projection @ np.array([*at_m, 1.0])
        return float(u / w * 1000.0), float(v / w * 1000.0)
