"""`pointit devices`: all plug-ins search side by side, and none costs the others anything."""

import json
import signal
import sys
import threading
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from pointit.cli.main import command
from pointit.cli.plugins import devices
from pointit.plugins import DevicePlugin, PluginGroup, device_search
from pointit.plugins.device_search import ShippedDevices
from tests.support.strangers import installed

STRANGERS = """
import asyncio, signal, threading
from pointit.plugins import Config, ConfigError, DevicePlugin, FoundDevice

END = threading.Event()

async def finds(seconds):
    band = FoundDevice("F1:22", "Wristband \\x1b[31m, 80 %", {"rssi_dbm": -60.0})
    return [band, FoundDevice("", "Any one")]

async def spaced(seconds):
    return [FoundDevice("Anna's phone", "Phone")]

async def agvs(seconds):
    return [FoundDevice("hub", "AGV", {"broker": "hub", "serial_number": "no 7"})]

async def nothing(seconds):
    return []

async def adapter(seconds):
    raise ConfigError("there is no Bluetooth adapter: plug one in")

async def raises(seconds):
    raise SystemExit("no")

async def hangs(seconds):
    await asyncio.Event().wait()

async def blocks(seconds):
    END.wait()

async def interrupts(seconds):
    signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
    END.wait()

async def nonsense(seconds):
    return ["COM1"]

ROWS = {
    search.__name__: DevicePlugin(summary="found", config=Config, discover=search)
    for search in (finds, spaced, agvs, nothing, adapter, raises, hangs, blocks, interrupts, nonsense)
}
globals().update({name.upper(): row for name, row in ROWS.items()})
UNSEARCHED = DevicePlugin(summary="cannot be found", config=Config)
"""


@pytest.fixture
def package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> Generator[dict[str, PluginGroup[Any]]]:
    """Install the wrists, lights and robots that the test names as the only ones, and give their groups."""
    wrists, lights, robots = (
        "\n".join(f"{name} = found_devices:{name.upper()}" for name in names.split())
        for names in (*request.param, "nothing")[:3]
    )
    monkeypatch.setattr(device_search, "TIMEOUT_S", 1.0)
    with installed(
        tmp_path, "found_devices", STRANGERS, found_wrists=wrists, found_lights=lights, found_robots=robots
    ):
        groups: dict[str, PluginGroup[Any]] = {
            "imu-source": PluginGroup("pointit.found_wrists", DevicePlugin, "IMU source", has_ours=False),
            "led-output": PluginGroup("pointit.found_lights", DevicePlugin, "LED output", has_ours=False),
            "robot": PluginGroup("pointit.found_robots", DevicePlugin, "robot driver", has_ours=False),
        }
        monkeypatch.setattr(devices, "GROUPS", groups)
        monkeypatch.setattr(devices, "MOCAP_SYSTEMS", ShippedDevices("found_mocap", "motion capture"))
        monkeypatch.setattr(devices, "HOME_ASSISTANTS", ShippedDevices("found_homes", "Home Assistant"))
        try:
            yield groups
        finally:
            sys.modules["found_devices"].END.set()
            for thread in threading.enumerate():
                if thread.name.startswith("search ") and thread.is_alive():  # Ctrl-C may come before
                    thread.join()
            del sys.modules["found_devices"]


def run(*options: str) -> Result:
    return CliRunner().invoke(command, ["devices", "--seconds", "0.1", *options])


@pytest.mark.parametrize("package", [("finds unsearched", "nothing spaced")], indirect=True)
@pytest.mark.usefixtures("package")
def test_found_devices_are_shown_with_the_option_that_uses_them() -> None:
    shown = run()
    assert shown.exit_code == 0
    wrists, lights = shown.output.split("Outputs:")
    assert wrists.startswith("Wrists:")
    lines = [" ".join(line.split()) for line in wrists.splitlines()]
    assert "--imu finds:F1:22 Wristband ?[31m, 80 %" in lines
    assert "--imu finds Any one" in lines
    assert """--output 'spaced:Anna'"'"'s phone'""" in lights
    assert shown.stderr == ""


@pytest.mark.parametrize("package", [("finds", "spaced")], indirect=True)
def test_devices_found_while_the_terminal_is_stopped_are_listed(
    package: dict[str, PluginGroup[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(device_search, "TIMEOUT_S", 0.0)

    def tell(_done: int) -> None:
        """Return when all have answered, which is later than they may."""
        for thread in threading.enumerate():
            if thread.name.startswith("search "):
                thread.join()

    results = device_search.search(package, 0.0, tell)
    assert [(each.name, each.problem) for each in results if each.name != "nothing"] == [
        ("finds", ""),
        ("spaced", ""),
    ]


@pytest.mark.parametrize("package", [("nothing", "nothing", "agvs")], indirect=True)
@pytest.mark.usefixtures("package")
def test_found_robots_are_shown_with_the_parameters_that_choose_them() -> None:
    words = "--set robot.driver=agvs --set robot.agvs.broker=hub --set 'robot.agvs.serial_number=no 7'"
    assert [row["use"] for row in json.loads(run("--json").stdout)["robots"]] == [words]


@pytest.mark.parametrize("package", [("finds unsearched", "nothing")], indirect=True)
@pytest.mark.usefixtures("package")
def test_json_has_addresses_labels_and_details() -> None:
    tables = json.loads(run("--json").stdout)
    assert tables == {
        "wrists": [
            {
                "use": "--imu finds:F1:22",
                "name": "finds",
                "address": "F1:22",
                "label": "Wristband \x1b[31m, 80 %",
                "details": {"rssi_dbm": -60.0},
            },
            {"use": "--imu finds", "name": "finds", "address": "", "label": "Any one", "details": {}},
        ],
        "lights": [],
        "robots": [],
        "mocap": [],
        "home_assistants": [],
        "not_searched": [],
    }


@pytest.mark.parametrize("package", [("blocks finds hangs raises", "adapter nonsense spaced")], indirect=True)
@pytest.mark.usefixtures("package")
def test_failed_or_hanging_search_is_named_and_delays_no_other() -> None:
    tables = json.loads(run("--json").stdout)
    assert [row["name"] for row in tables["wrists"]] == ["finds", "finds"]
    assert [row["name"] for row in tables["lights"]] == ["spaced"]
    reasons = {row["name"]: row["reason"] for row in tables["not_searched"]}
    package = "strangers-parts"
    assert reasons == {
        "blocks": f"IMU source 'blocks' of {package} did not end its search: update or uninstall {package}",
        "hangs": f"IMU source 'hangs' of {package} did not end its search: update or uninstall {package}",
        "raises": f"search of IMU source 'raises' of {package} failed (SystemExit: no)",
        "adapter": "there is no Bluetooth adapter: plug one in",
        "nonsense": f"search of LED output 'nonsense' of {package} found a str instead of a FoundDevice",
    }


@pytest.mark.parametrize("package", [("adapter nothing", "adapter raises")], indirect=True)
@pytest.mark.usefixtures("package")
def test_absent_devices_and_failed_searches_are_reported() -> None:
    shown = run()
    assert shown.stdout == (
        "No wrists found.\nNo outputs found.\nNo robots found.\nNo motion capture servers found.\n"
        "No Home Assistants found.\n"
    )
    assert shown.stderr == (
        "adapter, adapter: there is no Bluetooth adapter: plug one in\n"
        "raises: search of LED output 'raises' of strangers-parts failed (SystemExit: no)\n"
    )


@pytest.mark.parametrize("package", [("blocks", "interrupts")], indirect=True)
@pytest.mark.usefixtures("package")
def test_ctrl_c_ends_it_while_searches_hang(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device_search, "TIMEOUT_S", 3600.0)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        assert run("--seconds", "60").exit_code == 1  # `run_command` makes it 130
    finally:
        signal.signal(signal.SIGINT, before)
