"""The window: the page in a browser, its errors, and the page coordinates of objects in the room."""

import asyncio
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal
from urllib.parse import urlsplit

from playwright.async_api import Browser, ConsoleMessage, Page, WebSocket, expect

from pointit.runtime.bus.contract import Bus
from pointit.schemas import SetSpeed
from pointit.schemas.topics import SET_SPEED
from pointit.services.conveyor_sim.config import ConveyorSimConfig
from tests.e2e.web.page_record import PageRecord
from tests.support.pace import Patience

PATIENCE_S = 30.0
TRY_S = 5.0
"""An object is aimed at for so long: it may be hidden by another, or hang together with it."""
USUAL_MPS = ConveyorSimConfig().speed_mps
VIOLATIONS = """
window.violations = [];
document.addEventListener('securitypolicyviolation',
  (event) => window.violations.push(`${event.violatedDirective}: ${event.blockedURI}`));
"""
FRAME_MS = 250
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
TOLD = """
window.told = [];
document.addEventListener("DOMContentLoaded", () => new MutationObserver(() => {
  const text = ["progress", "toasts", "guide"].map((id) => document.getElementById(id).textContent).join(" ");
  if (text !== window.told.at(-1)) window.told.push(text);
}).observe(document.body, { childList: true, subtree: true, characterData: true }));
"""
"""Keeps what the page says for some seconds only, which a busy machine looks for too seldom."""
SHOWN = """() => {
  const { site, stats } = window.pointit ?? {};
  return Boolean(site && site.connected && site.map && site.status && stats && stats.fps > 0);
}"""
DRAWN_ANEW = """() => new Promise((done) => {
  setTimeout(() => requestAnimationFrame(() => requestAnimationFrame(done)), 1200);
})"""
"""The page looks at its cards once a second, and the frame after shows it."""
FREE = """(kind) => {
  const { site, stats: { lens } } = window.pointit;
  const { left, top, width, height } = document.querySelector("#view canvas").getBoundingClientRect();
  const row = (at, i) => [0, 1, 2, 3].reduce((sum, axis) => sum + lens[i + 4 * axis] * [...at, 1][axis], 0);
  const taken = (site.selection?.objects ?? []).map(({ id }) => id);
  const found = [...site.objects.values()].flatMap(({ objects }) => objects)
    .filter((each) => each.kind === kind && !taken.includes(each.id))
    .map(({ id, position_m: at }) => [id, row(at, 0) / row(at, 3), row(at, 1) / row(at, 3)])
    .filter(([, x]) => Math.abs(x) < 0.5)
    .map(([id, x, y]) => [id, [left + (1 + x) * width / 2, top + (1 - y) * height / 2]]);
  return found.length ? Object.fromEntries(found) : null;
}"""
"""Page coordinates of the objects of a kind that nobody has selected, in the middle of the scene, by id."""

LENS = "Array.from(window.pointit.stats.lens, (value) => Math.round(value * 1000))"
"""Rounded, since the last digits change while the camera stands still."""

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
        opened.set_default_timeout(2 * PATIENCE_S * 1000)
        window = cls(await opened.new_page())
        window._listen(urlsplit(url).netloc)
        await PageRecord.begin(window.page, urlsplit(url).path)
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

    def _on_sent(self, text: str | bytes) -> None:
        part = json.loads(text)
        if part["kind"] != "ack":
            self.sent.append(part)
        elif part["latency_ms"] is not None:
            self.latencies_ms.append(part["latency_ms"])

    async def is_shown(self, patience_s: float = PATIENCE_S) -> None:
        await self.until(SHOWN, "the site is shown", patience_s)

    async def is_still(self) -> None:
        """Wait until the camera stands still: cards, at which the page looks each second, make it move."""
        patience = Patience(PATIENCE_S)
        before = None
        while (lens := await self.page.evaluate(LENS)) != before:
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

    async def has_told(self, words: str) -> None:
        """Wait until the page, opened with `TOLD`, has ever shown `words`."""
        await self.until(f"window.told.some((text) => text.includes({json.dumps(words)}))", words, 60)

    async def violations(self) -> list[str]:
        return list(await self.page.evaluate("window.violations"))

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

    async def selects(self, bus: Bus, kind: str, is_done: Callable[[], bool]) -> None:
        """Keep the mouse on objects of `kind`, one after another, until `is_done`.

        The belts stand still meanwhile and afterwards: a slow mouse would stay behind what moves.
        """
        patience = Patience(2 * PATIENCE_S)
        while not is_done():
            assert not patience.is_over(), f"{patience} on {kind} ones in vain"
            await bus.call(SET_SPEED, SetSpeed(speed_mps=USUAL_MPS))
            seen = await self.until(f"({FREE})({kind!r})", f"{kind} ones")
            await bus.call(SET_SPEED, SetSpeed(speed_mps=0.0))
            for name in seen:
                trying = Patience(TRY_S)
                while not is_done() and not trying.is_over():
                    free: dict[str, tuple[float, float]] = (
                        await self.page.evaluate(f"({FREE})({kind!r})") or {}
                    )
                    if name not in free:
                        break
                    await self.page.mouse.move(*free[name])
                    await asyncio.sleep(0.03)
