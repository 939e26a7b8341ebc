"""Devices: found, connected by a page with the right to, remembered, forgotten; refused to all others."""

import asyncio
import contextlib
import json
from pathlib import Path
from typing import Any

import psutil
import pytest

from pointit.bridges.web.devices import run_command, search
from pointit.plugins import FoundDevice, device_search
from pointit.runtime.host.state_file import site_folder
from pointit.schemas import Done, Environment, ShowPixels, Strip, topics
from tests.integration.web.pages import VIEWER, Page, serving
from tests.support.bench import Bench, memory_bench, until

FOUND = {
    "imu-source": (
        FoundDevice("02:00", "Tracker 02:00; --set imu-bridge.slimevr.host=0.0.0.0", {"ip": "192.168.1.7"}),
        FoundDevice("Anna's phone", "Phone"),
    ),
    "led-output": (
        FoundDevice("x" * 300, "Odd", {"pixels": 1}),
        FoundDevice("kitchen.local", "Kitchen, 60 pixels", {"pixels": 60}),
    ),
    "home-assistant": (FoundDevice("http://192.168.1.5:8123", "Home, 2025.4.4"),),
}
LIGHT = {"kind": "light", "plugin": "ddp", "address": "kitchen.local", "name": "shelf"}
WRIST = {"kind": "wrist", "plugin": "slimevr", "address": "02:00", "name": "anna"}
AT = "tcp/127.0.0.1:1"
BEGIN = run_command.BEGIN
LIKE_A_DEVICE = """
import json, pathlib, sys
with pathlib.Path({file!r}).open("a") as file:
    print(json.dumps(sys.argv[1:]), file=file)
if "calibrate" in sys.argv:
    print("anna: good, the arm rested ahead", file=sys.stderr)
    print(json.dumps({{"about_arm_deg": 90.0}}, indent=2))
elif "broken" in sys.argv:
    sys.exit("Error: nothing answers.")
else:
    print('{{"warnings": []}}', flush=True)
    sys.stdin.read()
"""
"""In place of `pointit`: notes its arguments in a file, and does what the command would print."""


@pytest.fixture(autouse=True)
def started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the file of the command lines that were started."""

    def find(*_arguments: object) -> list[device_search.SearchResult]:
        plugins = {"imu-source": "slimevr", "led-output": "ddp", "home-assistant": "home-assistant"}
        results = [
            device_search.SearchResult(kind=kind, name=plugins[kind], found=found)
            for kind, found in FOUND.items()
        ]
        return [*results, device_search.SearchResult(kind="robot", name="x", problem="no Bluetooth adapter")]

    monkeypatch.setattr(search, "search", find)
    file = tmp_path / "started"
    file.touch()
    monkeypatch.setattr(run_command, "BEGIN", LIKE_A_DEVICE.format(file=str(file)))
    return file


def commands(file: Path) -> list[list[str]]:
    return [json.loads(line) for line in file.read_text().splitlines()]


def wearers() -> list[str]:
    """Return for whom processes of wrists run."""
    lines: list[list[str]] = []
    for child in psutil.Process().children():
        with contextlib.suppress(psutil.Error):
            lines.append(child.cmdline())
    return [line[-1] for line in lines if "person" in line and "add" in line]


async def room(bench: Bench, page: Page) -> None:
    strip = Strip(id="shelf", line_m=((0, 0, 1), (1, 0, 1)), pixels=60)
    bench.put(topics.MAP, Environment(stamp_ns=0, name="room", strips=(strip,)))
    await until(lambda: bool(page.states.get(("map", ""))))
    assert not (await page.ask(deed="find_devices"))["error"]


async def refusal(page: Page, **changes: Any) -> str:
    answer = await page.ask(deed="connect_device", query={**LIGHT, **changes})
    return str(answer["error"])


def line(page: Page, kind: str) -> dict[str, Any]:
    lines: list[dict[str, Any]] = page.status.get("devices", [])
    return next((each for each in lines if each["kind"] == kind), dict[str, Any]())


async def test_devices_are_found_with_their_options() -> None:
    async with memory_bench() as bench, serving(bench) as server, server.page() as page:
        reply = (await page.ask(deed="find_devices"))["reply"]
        assert [(each["use"], each["label"], each["pixels"]) for each in reply["devices"]] == [
            ("--imu slimevr:02:00", "Tracker 02:00", 0),
            ("""--imu 'slimevr:Anna'"'"'s phone'""", "Phone", 0),
            ("--output ddp:kitchen.local", "Kitchen, 60 pixels", 60),
        ]
        command = "pointit map import home-assistant --url http://192.168.1.5:8123 --token-file ~/ha.token"
        home = {"label": "Home, 2025.4.4", "command": command, "url": "http://192.168.1.5:8123"}
        assert reply["homes"] == [home]
        problems = ["ddp: a device has an address that cannot be used", "x: no Bluetooth adapter"]
        assert (sorted(reply["problems"]), reply["can_connect"]) == (problems, False)
        assert "belongs to no run" in await refusal(page)


async def test_only_an_operator_may_find_connect_test_and_forget(started: Path) -> None:
    asked: list[dict[str, Any]] = [
        {"deed": "find_devices"},
        {"deed": "connect_device", "query": LIGHT},
        *(
            {"deed": deed, "query": {"id": "x"}}
            for deed in ("forget_device", "show_device", "check_mounting")
        ),
    ]
    async with memory_bench() as bench, serving(bench, devices_at=AT) as server:
        async with server.page(VIEWER) as page:
            for wish in asked:
                assert "only looks on" in (await page.ask(**wish))["error"], wish
        async with server.page() as page:
            await room(bench, page)
            assert not (await page.ask(**asked[1]))["error"]
            await until(lambda: bool(line(page, "light").get("is_on")))
            for wish in asked[2:]:
                assert (
                    "no device 'x' is connected; connected: light shelf" in (await page.ask(**wish))["error"]
                )

            async with server.page(VIEWER) as viewer:
                await until(lambda: "devices" in viewer.status)
                assert viewer.status["devices"] == []
    assert len(commands(started)) == 1


async def test_light_is_connected_tested_stored_and_forgotten(started: Path) -> None:
    shown: list[ShowPixels] = []

    async def show(query: ShowPixels, _name: str) -> Done:
        shown.append(query)
        return Done()

    expected = ["output", "add", "--strip=shelf", "--json"]
    async with memory_bench() as bench:
        bench.bus.serve(topics.SHOW_PIXELS, show)
        async with serving(bench, devices_at=AT) as server, server.page() as page:
            await room(bench, page)
            reply = (await page.ask(deed="connect_device", query=LIGHT))["reply"]
            assert reply["message"].startswith("strip shelf is on Kitchen, 60 pixels; it is connected again")
            await until(lambda: bool(line(page, "light").get("is_on")))
            assert not (await page.ask(deed="show_device", query={"id": reply["id"]}))["error"]
            assert {pixel for lit in shown[0].lit for pixel in lit.pixels} <= set(range(60))
        async with serving(bench, devices_at=AT) as server, server.page() as page:
            await until(lambda: bool(line(page, "light").get("is_on")))
            assert not (await page.ask(deed="forget_device", query={"id": reply["id"]}))["error"]
            await until(lambda: not line(page, "light"))
        async with serving(bench, devices_at=AT) as server, server.page() as page:
            await page.ask(deed="find_devices")
            assert not line(page, "light")
    expected += ["--site", bench.bus.site, "--connect", AT, "--", "ddp:kitchen.local"]

    assert commands(started) == [expected, expected]


async def test_device_name_with_a_dash_is_no_option(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its command comes to the device, with a sentence, and not to the help or another option."""
    monkeypatch.setattr(run_command, "BEGIN", BEGIN)
    stored = [
        {"kind": "light", "plugin": "--help", "name": "shelf", "label": "a"},
        {"kind": "wrist", "plugin": "udp", "name": "-anna", "label": "c"},
    ]
    async with memory_bench() as bench:
        file = site_folder(bench.bus.site, "web") / "devices.json"
        file.parent.mkdir(parents=True)
        file.write_text(json.dumps({"devices": stored}))
        async with serving(bench, devices_at="tcp/127.0.0.1:9") as server, server.page() as page:
            await until(lambda: len(page.status.get("devices", ())) == 2)
            await until(lambda: all(each["problem"] for each in page.status["devices"]), patience_s=120.0)
            problems = {each["label"]: each["problem"] for each in page.status["devices"]}

    assert "no LED output '--help' is installed" in problems["a"]
    assert "user '-anna': use 1 to 64 letters" in problems["c"]


async def test_wrist_is_a_person_whose_mounting_is_checked(started: Path) -> None:
    async with memory_bench() as bench, serving(bench, devices_at=AT) as server, server.page() as page:
        await room(bench, page)
        reply = (await page.ask(deed="connect_device", query=WRIST))["reply"]
        await until(lambda: bool(commands(started) and line(page, "wrist")))
        assert not line(page, "wrist")["is_on"], "no imu-bridge is there"

        bench.bus.announce(topics.SERVICE_ALIVE, "imu-bridge.anna")
        await until(lambda: bool(line(page, "wrist").get("is_on")))
        fit = await page.ask(deed="check_mounting", query={"id": reply["id"]})
        assert fit["reply"] == {"about_arm_deg": 90.0}

        other = {**WRIST, "name": "ben"}
        bench.bus.announce(topics.SERVICE_ALIVE, "imu-bridge.ben")
        await until(lambda: "imu-bridge.ben" in {each["instance"] for each in page.status["services"]})
        assert "ben is there already" in (await page.ask(deed="connect_device", query=other))["error"]
        assert (
            "user 'a b': use"
            in (await page.ask(deed="connect_device", query={**WRIST, "name": "a b"}))["error"]
        )
    (arguments, measure) = commands(started)
    assert arguments[:3] == ["person", "add", "--imu=slimevr:02:00"]
    assert "--set=imu-bridge.slimevr.host=0.0.0.0" in arguments, "it is on another machine"
    assert arguments[-2:] == ["--", "anna"]
    assert (measure[:3], measure[-2:]) == (["person", "calibrate", "mounting"], ["--", "anna"])


async def test_device_connected_by_two_pages_has_one_process(started: Path) -> None:
    async with (
        memory_bench() as bench,
        serving(bench, devices_at=AT) as server,
        server.page() as page,
        server.page() as other,
    ):
        await room(bench, page)
        for name in ("anna", "carla"):
            wanted = {**WRIST, "name": name}
            asked = [each.ask(deed="connect_device", query=wanted) for each in (page, other)]
            assert [answer["error"] for answer in await asyncio.gather(*asked)] == ["", ""]
        await until(lambda: [each["name"] for each in page.status["devices"]] == ["carla"])
        await until(lambda: wearers() == ["carla"], what="one process")
        await until(lambda: bool(commands(started)) and commands(started)[-1][-1] == "carla")


async def test_stored_light_waits_while_the_run_uses_its_controller(started: Path) -> None:
    async with memory_bench() as bench:
        async with serving(bench, devices_at=AT) as server, server.page() as page:
            await room(bench, page)
            assert not await refusal(page)
            await until(lambda: len(commands(started)) == 1)
        taken = {"devices_at": AT, "run_output": "ddp:kitchen.local"}
        async with serving(bench, **taken) as server, server.page() as page:
            told = "`--output ddp:kitchen.local` of this run drives it; leave that out, or forget"
            await until(lambda: str(line(page, "light").get("problem", "")).startswith(told))
            assert not line(page, "light")["is_on"]

        assert len(commands(started)) == 1
        async with (
            serving(bench, devices_at=AT, run_output="ddp:hall.local") as server,
            server.page() as page,
        ):
            await until(lambda: bool(line(page, "light").get("is_on")))


async def test_damaged_device_list_is_kept_beside_the_next_one() -> None:
    async with memory_bench() as bench:
        file = site_folder(bench.bus.site, "web") / "devices.json"
        file.parent.mkdir(parents=True)
        file.write_text("{broken")
        health = bench.collect(topics.HEALTH, "web")
        async with serving(bench, devices_at=AT) as server, server.page() as page:
            await room(bench, page)
            await until(lambda: any("devices are not known" in str(each.warnings) for each in health))
            assert not await refusal(page)
        assert file.with_name("devices.json.bad").read_text() == "{broken"
        assert "kitchen.local" in file.read_text()


async def test_device_is_refused_in_a_sentence_when_it_cannot_connect(
    started: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with memory_bench() as bench, serving(bench, devices_at=AT) as server, server.page() as page:
        await room(bench, page)
        assert "was not found: look for devices first" in await refusal(page, address="192.168.1.1")
        assert "was not found" in await refusal(page, plugin="replay", address="file.csv")
        assert "name" in await refusal(page, name="")
        assert commands(started) == []
        assert not await refusal(page)
        monkeypatch.setitem(FOUND, "led-output", (FoundDevice("hall.local", "Hall"),))
        await page.ask(deed="find_devices")
        assert "is on Kitchen, 60 pixels: forget that one first" in await refusal(page, address="hall.local")
        assert "how many pixels" in await refusal(page, address="hall.local", name="hall")


async def test_ended_device_is_a_problem_with_its_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(run_command, "BEGIN", f"import sys; sys.argv.append('broken'){run_command.BEGIN}")
    async with memory_bench() as bench, serving(bench, devices_at=AT) as server, server.page() as page:
        health = bench.collect(topics.HEALTH, "web")
        await room(bench, page)
        assert not await refusal(page)
        await until(lambda: line(page, "light").get("problem") == "nothing answers")
        await until(lambda: any("Kitchen, 60 pixels: nothing answers" in each.warnings for each in health))
        monkeypatch.setattr(run_command, "BEGIN", run_command.BEGIN.replace("'broken'", "'mended'"))
        monkeypatch.setitem(FOUND, "led-output", ())
        await page.ask(deed="find_devices")
        assert not await refusal(page), "it is connected already, so it is not searched"
        await until(lambda: bool(line(page, "light")["is_on"]))
        assert not line(page, "light")["problem"]


async def test_unreadable_device_file_is_named_and_kept(own_state: Path) -> None:
    async with memory_bench() as bench:
        file = own_state / bench.bus.site / "web" / "devices.json"
        file.parent.mkdir(parents=True)
        file.write_text("{broken")
        async with serving(bench, devices_at=AT) as server, server.page():
            health = bench.collect(topics.HEALTH, "web")
            await until(lambda: any("devices.json" in "".join(each.warnings) for each in health))
        assert file.read_text() == "{broken"


STUBBORN = "import signal, time; signal.signal(15, signal.SIG_IGN); print('{}', flush=True); time.sleep(60)"


async def test_process_is_killed_when_it_does_not_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_command, "BEGIN", STUBBORN)
    monkeypatch.setattr(run_command, "STOP_TIMEOUT_S", 0.05)
    told: list[object] = []
    running = asyncio.create_task(run_command.run_command([], lambda _line: None, told.append))
    await until(lambda: bool(told))
    running.cancel()
    done, _ = await asyncio.wait({running}, timeout=30.0)  # it would sleep for a minute
    assert done
    assert running.cancelled()


async def test_command_that_is_cancelled_again_leaves_no_process(started: Path) -> None:
    others = {*psutil.Process().children()}
    for rounds in (0, 1, 2, 3, 5, 8, 40):
        running = asyncio.create_task(run_command.run_command(["wrist"], lambda _: None, lambda _: None))
        for _ in range(rounds):
            await asyncio.sleep(0)
        if rounds == 40:
            await until(lambda: bool(started.read_text()), what="the command to run")
        while not running.done():
            running.cancel()
            await asyncio.sleep(0)
        with pytest.raises(asyncio.CancelledError):
            await running
        assert {*psutil.Process().children()} <= others, rounds


async def test_process_is_ended_when_all_tasks_are_cancelled_once_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As a loop that closes does while the process is slow to end."""
    monkeypatch.setattr(run_command, "BEGIN", STUBBORN)
    before = asyncio.all_tasks()
    others = {*psutil.Process().children()}
    told: list[object] = []
    running = asyncio.create_task(run_command.run_command([], lambda _line: None, told.append))
    await until(lambda: bool(told))

    running.cancel()
    for _ in range(5):
        await asyncio.sleep(0)
    for task in asyncio.all_tasks() - before:
        task.cancel()

    done, _ = await asyncio.wait({running}, timeout=30.0)
    assert done
    assert {*psutil.Process().children()} <= others
