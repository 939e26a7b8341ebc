"""A study in two browsers: the participant's and the experimenter's."""

import base64
import csv
import re
from pathlib import Path

import pytest
from playwright.async_api import Browser, expect

from tests.e2e.web.axe import check_look
from tests.support.commands import Commands

pytestmark = [pytest.mark.slow, pytest.mark.long]

STUDY = """
name: small
participants: 2
task: {kind: reach}
end: ends.py:on
timeout_s: 600
repetitions: 3
consent: Times are <b>recorded</b>.
instruction: {text: Point at the red segment., image: room.png, alt: The room}
questionnaires: [nasa-tlx, {name: own, items: [It was fun.]}]
"""
ENDS = """
from pathlib import Path

def on(now):
    return "hit" if Path(__file__).with_name("go").exists() and now.hovered == now.target else None
"""
"""No trial ends before there is a file `go`, however late the experimenter's orders come."""
DOT = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
"""A picture of one pixel."""
PATIENCE_MS = 60_000
PHONE = {"width": 390, "height": 844}


async def test_study_runs_in_two_browsers(browser: Browser, commands: Commands, tmp_path: Path) -> None:
    (tmp_path / "small.yaml").write_text(STUDY)
    (tmp_path / "ends.py").write_text(ENDS)
    (tmp_path / "room.png").write_bytes(base64.b64decode(DOT))
    arguments = ("study", "run", str(tmp_path / "small.yaml"), "--to", str(tmp_path / "data"), "--no-record")
    command = commands.start(*arguments, "--page")
    await command.says("page of the experimenter")
    links = re.findall(r"http://\S+", command.out)
    participant, experimenter = [await (await browser.new_context(viewport=PHONE)).new_page() for _ in links]
    faults: list[str] = []
    for page, link in ((participant, links[0]), (experimenter, links[1])):
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.set_default_timeout(PATIENCE_MS)
        await page.goto(link)
    expect.set_options(timeout=PATIENCE_MS)
    press = participant.get_by_role
    order = experimenter.get_by_role

    await expect(participant.get_by_text("Times are <b>recorded</b>.")).to_be_visible()
    await expect(experimenter.get_by_text("Reading")).to_be_visible()
    for term in await experimenter.locator("dt").all():  # nothing is known of a trial yet
        await expect(term).to_be_hidden()
    await check_look(experimenter)
    refused = await participant.context.new_page()
    await refused.goto(re.sub("/[^/]+/$", "/wrong/", links[0]))
    await check_look(refused)
    await refused.close()
    await check_look(participant)
    await press("button", name="Next").click()
    await expect(participant.get_by_role("alert")).to_contain_text("Tick that you agree")
    await participant.get_by_label("I have read this").check()
    await press("button", name="Next").click()
    picture = participant.get_by_role("img", name="The room")
    await expect(picture).to_be_visible()
    assert await picture.evaluate("image => image.complete && image.naturalWidth") == 1
    await press("button", name="Begin").click()

    state = experimenter.locator("#state")
    await expect(state).to_have_text("pointing")
    room = experimenter.get_by_role("img", name="The room from above")
    for part in ("polyline", ".person", ".ray", ".cursor", ".target"):
        await expect(room.locator(part).first).to_be_attached()
    await order("button", name="Repeat").click()
    await expect(experimenter.locator("#outcomes")).to_contain_text("1: repeated: repeat by the experimenter")
    await order("button", name="Pause").click()
    await expect(state).to_have_text("paused")
    await participant.reload()
    await expect(participant.get_by_role("heading", name="Paused")).to_be_visible()
    await check_look(experimenter)
    await order("button", name="Skip").click()
    await expect(experimenter.get_by_role("alert")).to_contain_text("Write why")
    await experimenter.get_by_label("Reason").fill("sneezed")
    (tmp_path / "go").touch()
    await order("button", name="Skip").click()

    await expect(participant.get_by_role("slider")).to_have_count(6)
    await expect(state).to_have_text("Answering nasa-tlx")
    await expect(experimenter.get_by_text("Mental demand")).to_have_count(0)  # it is on one page only
    await press("button", name="Next").click()
    await expect(participant.get_by_role("alert")).to_have_text("6 answers are missing.")
    for slider in await participant.get_by_role("slider").all():
        await slider.press("ArrowRight")
    await check_look(participant)
    await press("button", name="Next").press("Enter")
    await participant.get_by_role("radio", name="4").check()
    await press("button", name="Next").click()
    for page in (participant, experimenter):
        await expect(page.get_by_text("You may close this page.")).to_be_visible()
    assert "P01 has finished" in (await command.end(code=0)).out
    assert faults == []

    with (tmp_path / "data/P01/trials.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    counted = [row for row in rows if not row["reason"].startswith("repeated")]
    assert [row["trial"] for row in counted] == ["1", "2", "3"]
    assert [row["reason"] for row in rows if row["outcome"] == "skipped"][-1] == "skipped: sneezed"
    assert [row["outcome"] for row in counted].count("hit") == 2
    with (tmp_path / "data/P01/answers.csv").open(newline="") as file:
        assert [row["value"] for row in csv.DictReader(file)] == ["55"] * 6 + ["4"]
