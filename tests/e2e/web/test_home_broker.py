"""`pointit home` with a genuine MQTT broker: from the first card to the first lamp that pointing switches."""

import asyncio
from pathlib import Path

import pytest
from playwright.async_api import Browser, expect

from tests.devices.test_broker_lamps import TASMOTA_LIGHT, Devices, devices_on
from tests.e2e.web import test_home
from tests.e2e.web.axe import violations
from tests.e2e.web.test_home import LAMPS, Hand, HomeRun, choose, paired_phone, place, run, title, use
from tests.e2e.web.window import NO_WEBGL, Window
from tests.support.announced_lights import RELAY_LIGHT, ZIGBEE_LIGHT
from tests.support.bench import until
from tests.support.buses import free_port
from tests.support.mqtt import broker

__all__ = ["run"]
pytestmark = pytest.mark.slow

USER = "anna"
PASSWORD = "open sesame"  # noqa: S105 - of a test
LABELS = {ZIGBEE_LIGHT: "cuinaLlumTaulell", TASMOTA_LIGHT: "desk", RELAY_LIGHT: "NodeMCU1 1"}


async def password_options(folder: Path) -> str:
    """Return the options of a broker that asks for the password."""
    passwords = folder / "passwords"
    making = await asyncio.create_subprocess_exec("mosquitto_passwd", "-b", "-c", passwords, USER, PASSWORD)
    assert await making.wait() == 0
    return f"allow_anonymous false\npassword_file {passwords}\nuser root\n"


async def connect(window: Window, password: str) -> None:
    field = window.page.get_by_label("Password, if the address has a user")
    await field.fill(password)
    await field.press("Enter")


def is_as_before(devices: Devices) -> bool:
    zigbee = (devices.zigbee["state"], devices.zigbee["brightness"])
    return (*zigbee, devices.bulb, devices.relay) == ("OFF", 120, {"POWER": "ON", "Dimmer": 57}, "OFF")


async def test_lamps_of_a_broker_are_set_up_and_switched_by_pointing(
    browser: Browser, run: HomeRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The relay is not the last lamp of the second place: who still points where they pressed is refused
    positions_m = (LAMPS["light.desk"], LAMPS["light.shelf"], LAMPS["light.door"])
    monkeypatch.setattr(test_home, "LAMPS", dict(zip(LABELS, positions_m, strict=True)))
    monkeypatch.setattr(test_home, "LABELS", LABELS)
    port = free_port()
    options = await password_options(tmp_path)
    with broker(tmp_path, port, options):
        async with devices_on(port, username=USER, password=PASSWORD) as devices:
            # The broker: a password that is wrong, and the right one
            site = await run.start()
            window = await Window.open(browser, site.url, scripts=(NO_WEBGL,))
            await title(window, "Where are your lamps?")
            await window.page.get_by_label("MQTT broker").press("Space")
            url = window.page.get_by_label("Address of the broker")
            await expect(url).to_be_focused()
            await url.fill(f"mqtt://{USER}@127.0.0.1:{port}")
            await connect(window, "sesame")
            reason = window.page.locator(".setup .reason")
            await expect(reason).to_contain_text("refuses the user name or the password")
            assert await violations(window.page) == []
            await connect(window, PASSWORD)

            # Lamps, and one that cannot be used
            await title(window, "Which lamps do you want to point at?")
            await expect(window.page.locator(".setup")).to_contain_text("In_wall_study_switch cannot be used")
            assert await violations(window.page) == []
            await choose(window)
            await title(window, "What do you point with?")
            hand = Hand(await paired_phone(browser, site))
            await use(window, "Next")

            # Each is lit at its turn, and as before afterwards
            await title(window, "Where is each lamp?")
            await until(lambda: devices.zigbee["state"] == "ON", 10, "the first lamp, lit at its turn")
            await place(window, hand, [ZIGBEE_LIGHT, TASMOTA_LIGHT])
            await until(lambda: devices.relay == "ON", 10, "the last lamp, lit at its turn")
            await place(window, hand, [RELAY_LIGHT])
            await title(window, "Walk to a second place")
            await until(lambda: is_as_before(devices), 20, "all lamps as before")
            await use(window, "I am there")
            hand.place_m = test_home.SECOND_M
            await place(window, hand, test_home.in_standing_order())
            await hand.lower()
            await title(window, "Try it")
            await until(lambda: is_as_before(devices), 20, "all lamps as before")

            # The first lamp that pointing switches, and no other one
            async with asyncio.timeout(60):
                while devices.relay != "ON":
                    await hand.hold(RELAY_LIGHT, 0.5)
            assert (devices.zigbee["state"], devices.bulb["POWER"]) == ("OFF", "ON")
            assert window.faults == []

    # The password is in its file alone
    file = run.folder / "mqtt.password"
    assert (file.read_text(), file.stat().st_mode & 0o777) == (PASSWORD, 0o600)
    others = [other for other in run.folder.iterdir() if other != file]
    assert not [other.name for other in others if PASSWORD in other.read_text()]
    assert run.command is not None
    assert PASSWORD not in run.command.err
