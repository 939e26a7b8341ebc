"""The demo goes on while its page is open: there is always something to select."""

import asyncio

import pytest
from playwright.async_api import Browser, expect

from tests.e2e.web.site import running
from tests.e2e.web.window import NO_WEBGL, Window
from tests.support.commands import Commands
from tests.support.pace import Patience

pytestmark = [pytest.mark.slow, pytest.mark.long]

LENGTH_S = 300.0
"""Simulated time; a run without a page ends after 60 s."""
SPEED = 5
MAX_EMPTY_S = 60.0
"""Longest simulated time without anything to select: the simulated person takes most at once."""
TIME_AND_COUNT = """() => {
  const { site } = window.pointit;
  const taken = (site.selection?.objects ?? []).map(({ id }) => id);
  const all = [...site.objects.values()].flatMap(({ objects }) => objects);
  return [site.sentNs / 1e9, all.filter(({ id, kind }) => kind === "red" && !taken.includes(id)).length];
}"""


@pytest.mark.parametrize("scenario", ["scenario_3", "scenario_4"])
async def test_after_five_minutes_there_is_still_something_to_select(
    browser: Browser, commands: Commands, scenario: str
) -> None:
    site = await running(commands, scenario, "--speed", str(SPEED), "--seed", "1", ends_unseen=True)
    window = await Window.open(browser, site.url, scripts=(NO_WEBGL,))
    await window.until("Boolean(window.pointit?.site.map)")
    began_s, _ = await window.page.evaluate(TIME_AND_COUNT)
    now_s = last_s = began_s
    patience = Patience(4 * LENGTH_S / SPEED)
    while now_s < began_s + LENGTH_S:
        now_s, count = await window.page.evaluate(TIME_AND_COUNT)
        if count:
            last_s = now_s
        assert now_s - last_s < MAX_EMPTY_S, f"nothing to select {now_s - began_s:.0f} s after the start"
        assert not patience.is_over(), f"the site's time has come to {now_s - began_s:.0f} s only"
        await asyncio.sleep(0.2)
    await expect(window.page.locator("#ended")).to_be_hidden()
    assert window.faults == []
