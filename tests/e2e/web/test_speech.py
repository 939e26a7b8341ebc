"""A person speaks to the page while its mouse points for them: a scripted recogniser of the browser."""

import re
from typing import Any

import pytest
from playwright.async_api import Browser, expect

from tests.e2e.web.axe import violations
from tests.e2e.web.site import SitePage
from tests.e2e.web.test_window_things import BELOW_PX, NAME, SELECTED
from tests.e2e.web.window import Window
from tests.support.commands import Commands

pytestmark = [
    pytest.mark.slow,
    pytest.mark.long,
    pytest.mark.parametrize("site", [("shelf", "--with", "listener")], indirect=True),
]

RECOGNISER = """
window.SpeechRecognition = class {
  start() { window.recogniser = this; }
  abort() { window.recogniser = null; }
};
/** Say `text`: its words come one by one, then all of them for good. */
window.say = async (text) => {
  const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
  const tell = (transcript, isFinal) => window.recogniser.onresult({
    resultIndex: 0, results: [Object.assign([{ transcript, confidence: 0.9 }], { isFinal })] });
  const words = text.split(" ");
  window.recogniser.onspeechstart();
  for (let count = 1; count <= words.length; count++) {
    await pause(300);
    tell(words.slice(0, count).join(" "), false);
  }
  window.recogniser.onspeechend();
  await pause(200);
  tell(text, true);
};
"""


def spoken(window: Window) -> list[dict[str, Any]]:
    """Return the words of the last utterance that the page has sent."""
    sent = [part["query"]["words"] for part in window.sent if part.get("deed") == "speak"]
    return list(sent[-1])


async def test_words_of_the_browser_are_followed(
    browser: Browser, site: SitePage, commands: Commands
) -> None:
    listening = commands.start("listen", "user1", "--connect", site.endpoint)
    window = await Window.open(browser, site.url, scripts=(RECOGNISER,))
    page = window.page
    await window.is_shown()
    await listening.says("listening to user1")
    await page.get_by_role("button", name="Point with the mouse").click()
    await expect(page.locator("#guide")).to_contain_text("You are the arm now")
    await window.is_still()
    speech = page.get_by_label("Speech")
    listen = speech.get_by_role("button", name="Listen")
    understood = speech.locator(".understood")
    await listen.click()
    await expect(listen).to_have_attribute("aria-pressed", "true")

    x, y = await window.until(f"({NAME})('radio')", "the name of the radio is shown")
    await window.aimed_at(x, y + BELOW_PX, 10.0)
    await window.until(f"{SELECTED}.includes('radio')", "staying on the radio switches it on")
    await page.evaluate("window.say('turn that off')")
    await expect(understood).to_contain_text("“turn that off”: radio deselected")
    assert await page.evaluate(SELECTED) == []
    ages = [(word["start_s"], word["end_s"]) for word in spoken(window)]
    assert [word["text"] for word in spoken(window)] == ["turn", "that", "off"]
    assert ages == sorted(ages, reverse=True)
    assert 0.9 < ages[0][0] < 3.0, "of about 1.1 s of speech"

    places = [
        await window.until(f"({NAME})('{name}')", f"the name of {name} is shown")
        for name in ("screws", "nuts")
    ]
    (x, y), (other_x, other_y) = places
    assert await window.aimed_at((x + other_x) / 2, (y + other_y) / 2 + BELOW_PX, 10.0)
    await page.evaluate("window.say('take that')")
    await expect(understood).to_have_attribute("data-result", "asked")
    await expect(understood).to_contain_text(
        re.compile("(screws or nuts|nuts or screws)\\? Say yes", re.IGNORECASE)
    )
    assert await violations(page) == []
    await speech.get_by_role("button", name="Yes").click()
    await expect(understood).to_have_attribute("data-result", "done")
    # on already: staying between both may have fired one
    await expect(understood).to_contain_text(re.compile("(screws|nuts) (selected|is on already)"))

    await page.evaluate("window.say('good morning')")
    await expect(speech).to_contain_text("No command in that, or nobody follows: pointit listen user1")
    assert await violations(page) == []
    await listen.click()
    await expect(listen).to_have_attribute("aria-pressed", "false")
    assert await page.evaluate("window.recogniser") is None
    viewer = await Window.open(browser, site.viewer_url, scripts=(RECOGNISER,))
    await viewer.is_shown()
    await expect(viewer.page.get_by_role("button", name="Listen")).to_be_hidden()
    for each in (window, viewer):
        assert each.faults == []
        assert await each.violations() == []
