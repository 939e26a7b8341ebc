"""What the pages of a test have told, with times: a test that fails shows it."""

import time
from collections import deque
from dataclasses import dataclass, field
from typing import ClassVar

from playwright.async_api import ConsoleMessage, Page

LATEST = 40
"""Number of texts that are kept of each page."""
PREFIX = "page record: "
SCRIPT = f"""
document.addEventListener("DOMContentLoaded", () => {{
  const parts = "#guide, #progress, #toasts, .setup, .problems, #next, #link, #phone-status";
  let told = "";
  let waits = false;
  const tell = () => {{
    waits = false;
    const shown = [...document.querySelectorAll(parts)].filter((part) => part.offsetParent !== null);
    const text = shown.map((part) => part.innerText.trim()).filter(Boolean).join(" | ");
    if (text !== told) console.debug({PREFIX!r} + (told = text));
  }};
  new MutationObserver(() => {{
    if (!waits) waits = Boolean(setTimeout(tell, 250));
  }}).observe(document.body, {{ childList: true, subtree: true, characterData: true }});
}});
"""
"""Reports the texts for people four times a second at most, since reading them takes a layout of the page."""


@dataclass
class PageRecord:
    """Texts of one page for people, the newest last."""

    current: ClassVar[list["PageRecord"]] = []
    """Records of the pages that the present test has opened."""
    name: str
    texts: deque[tuple[float, str]] = field(default_factory=lambda: deque(maxlen=LATEST))
    """Monotonic time, s, and text."""

    @classmethod
    async def begin(cls, page: Page, name: str) -> "PageRecord":
        """Record what `page` tells from its next document on."""
        record = cls(name)
        cls.current.append(record)
        page.on("console", record._on_console)
        await page.add_init_script(SCRIPT)
        return record

    def _on_console(self, message: ConsoleMessage) -> None:
        if message.type == "debug" and message.text.startswith(PREFIX):
            text = message.text.removeprefix(PREFIX).replace("\n", " ")
            self.texts.append((time.monotonic(), text))

    def lines(self, now_s: float) -> list[str]:
        """Return the texts with the time of each before `now_s`, a monotonic time."""
        return [f"{time_s - now_s:8.2f} s  {text}" for time_s, text in self.texts]
