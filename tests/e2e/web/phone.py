"""A phone in the browser: its page, and how it is turned."""

import itertools
import math
from dataclasses import dataclass, field
from typing import Any, Literal

from playwright.async_api import Browser, Page, expect

from tests.e2e.web.page_record import PageRecord
from tests.support.pace import Patience

NO_SENSOR = "delete window.RelativeOrientationSensor"
NO_SOCKET = """
window.sockets = 0;
window.WebSocket = class { constructor() { window.sockets += 1; this.readyState = 3; this.bufferedAmount = 0;
  setTimeout(() => this.onclose && this.onclose({ code: 1006 }), 5); } send() {} close() {} };
"""
CUES = """
window.vibrations = []; navigator.vibrate = (pattern) => window.vibrations.push(pattern);
window.tones = 0; const start = OscillatorNode.prototype.start;
OscillatorNode.prototype.start = function (...at) { window.tones += 1; return start.apply(this, at); };
"""

Source = Literal["sensor", "event"]


@dataclass
class PhonePage:
    page: Page
    source: Source
    _cdp: Any
    faults: list[str] = field(default_factory=list[str])
    """Errors of the console."""

    @classmethod
    async def open(
        cls,
        browser: Browser,
        url: str,
        *,
        source: Source = "sensor",
        scripts: tuple[str, ...] = (),
        **context: Any,
    ) -> "PhonePage":
        phone = {"viewport": {"width": 390, "height": 780}, "is_mobile": True, "has_touch": True}
        options: dict[str, Any] = {**phone, "ignore_https_errors": True, **context}
        page = await (await browser.new_context(**options)).new_page()
        await PageRecord.begin(page, "phone")
        faults: list[str] = []
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("console", lambda message: faults.append(message.text) if message.type == "error" else None)
        for script in (*scripts, *((NO_SENSOR,) if source == "event" else ())):
            await page.add_init_script(script)
        cdp: Any = await page.context.new_cdp_session(page)
        opened = cls(page, source, cdp, faults)
        if source == "sensor":
            await opened._emulate_sensor()
        await page.goto(url)
        return opened

    async def _emulate_sensor(self) -> None:
        metadata = {"available": True, "minimumFrequency": 1, "maximumFrequency": 60}
        for kind in ("relative-orientation", "accelerometer", "gyroscope"):
            await self._cdp.send(
                "Emulation.setSensorOverrideEnabled", {"enabled": True, "type": kind, "metadata": metadata}
            )

    async def turn(self, yaw_deg: float, pitch_deg: float) -> None:
        """Turn it: its top edge points to `yaw_deg` to the left, `pitch_deg` up, its screen does not roll."""
        if self.source == "event":
            angles = {"alpha": yaw_deg % 360, "beta": pitch_deg, "gamma": 0}
            await self._cdp.send("DeviceOrientation.setDeviceOrientationOverride", angles)
            return
        a = math.radians(yaw_deg) / 2
        b = math.radians(pitch_deg) / 2
        q = {
            "x": math.cos(a) * math.sin(b),
            "y": math.sin(a) * math.sin(b),
            "z": math.sin(a) * math.cos(b),
            "w": math.cos(a) * math.cos(b),
        }
        await self._cdp.send(
            "Emulation.setSensorOverrideReadings",
            {"type": "relative-orientation", "reading": {"quaternion": q}},
        )

    async def start(self, yaw_deg: float = 0.0, pitch_deg: float = -10.0) -> None:
        """Tap Start; the phone is held like this, with the tremor that every hand has."""
        await self.turn(yaw_deg, pitch_deg)
        await self.page.get_by_role("button", name="Start").tap()
        running = self.page.locator("#running")
        patience = Patience(60.0)
        for i in itertools.count():
            await self.turn(yaw_deg + 0.5 * (i % 2), pitch_deg)
            if await running.is_visible() or patience.is_over():
                break
            await self.page.wait_for_timeout(50)
        assert await running.is_visible(), f"the page has not started: {self.faults}"
        await expect(self.page.locator("#link")).to_have_text("Connected", timeout=30_000)
