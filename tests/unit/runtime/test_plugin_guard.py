"""Faults of a plug-in are named, restarted with back-off, and end with it; one that is missing is named."""

import asyncio
import contextlib
import functools
import importlib
import re
import sys
import types
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any, cast

import click
import pytest
from pydantic import ValidationError

from pointit.plugins import GROUPS
from pointit.runtime.config import installed
from pointit.runtime.config.plugins import Plugin, PluginConfig, PluginGroup
from pointit.runtime.errors import ConfigError
from pointit.runtime.service import plugin_guard
from pointit.runtime.service.plugin_guard import PluginGuard
from pointit.runtime.service.process import service_command
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.sources import SOURCES
from pointit.services.led_driver.outputs import validate_output
from pointit.services.robot.config import RobotConfig
from pointit.services.selector.config import SelectorConfig
from tests.support import strangers
from tests.support.bench import until


class Sink:
    def __init__(self) -> None:
        self.shown: dict[str, str] = {}
        self.last = ""

    def warn(self, code: str, sentence: str, subject: str = "") -> None:
        self.shown[subject or code] = self.last = sentence

    def clear(self, code: str, subject: str = "") -> None:
        self.shown.pop(subject or code, None)


@pytest.fixture
def sink() -> Sink:
    return Sink()


@pytest.fixture
def guard(sink: Sink, monkeypatch: pytest.MonkeyPatch) -> PluginGuard:
    monkeypatch.setattr(plugin_guard, "FIRST_WAIT_S", 0.001)
    monkeypatch.setattr(plugin_guard, "MAX_WAIT_S", 0.004)
    return PluginGuard("part 'mine' of strangers", sink)


async def ends() -> None:
    pass


async def raises() -> None:
    raise ValueError("no such port\nsecond line")


async def exits() -> None:
    sys.exit(3)


async def cancels_itself() -> None:
    raise asyncio.CancelledError


@pytest.mark.parametrize(
    ("run", "how"),
    [
        (ends, "ended by itself"),
        (raises, "failed (ValueError: no such port)"),
        (exits, "failed (RuntimeError: it called sys.exit)"),
        (cancels_itself, "ended by itself"),
    ],
)
async def test_plugin_that_ends_is_named_and_restarted_until_it_runs(
    run: Callable[[], Awaitable[None]],
    how: str,
    guard: PluginGuard,
    sink: Sink,
    caplog: pytest.LogCaptureFixture,
) -> None:
    runs = 0

    async def third_time_lucky() -> None:
        nonlocal runs
        runs += 1
        if runs > 3:
            with contextlib.suppress(asyncio.CancelledError):
                await asyncio.Event().wait()
            raise ValueError("port lost")
        await run()

    work = asyncio.create_task(guard.keep_running(third_time_lucky))
    await until(lambda: "3 times" in guard.problem)
    told = f"part 'mine' of strangers {how}, 3 times now; it will be restarted in 0.004 s"
    assert sink.shown == {guard.label: told}
    await until(lambda: not sink.shown)  # it runs again, and has for a while
    assert guard.problem == ""
    work.cancel()
    await asyncio.wait({work})
    assert work.cancelled()
    assert "part 'mine' of strangers failed while it was ending: ValueError: port lost" in caplog.text


def test_plugin_that_ignores_its_cancellation_is_abandoned(
    guard: PluginGuard, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(plugin_guard, "END_TIMEOUT_S", 0.01)
    stubborn_ends = asyncio.Event()

    async def stubborn() -> None:
        while not stubborn_ends.is_set():
            with contextlib.suppress(asyncio.CancelledError):
                await stubborn_ends.wait()

    async def site() -> None:
        work = asyncio.create_task(guard.keep_running(stubborn))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        work.cancel()
        await asyncio.wait({work})
        assert work.cancelled()
        assert "part 'mine' of strangers did not end when it was cancelled" in caplog.text
        assert len(plugin_guard.abandoned) == 1
        assert asyncio.all_tasks() == {asyncio.current_task()}  # asyncio.run waits for no other
        stubborn_ends.set()
        await until(lambda: not plugin_guard.abandoned)

    asyncio.run(site())


@pytest.mark.wall_time
async def test_health_names_plugin_and_line_that_have_blocked_the_loop(
    tmp_path: Path, sink: Sink, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(plugin_guard, "STALL_S", 0.05)
    monkeypatch.setattr(plugin_guard, "STALL_PERIOD_S", 0.001)
    monkeypatch.setattr(plugin_guard, "SHOWN_S", 0.01)
    plugin_guard.guard_of(SOURCES, "serial", sink)
    assert asyncio.get_running_loop() not in plugin_guard._watches, "ours are not watched"

    other = Sink()
    entries = "blocking = strangers_blocking:BLOCKING"
    source = """
def block(stop):
    while not stop():
        pass
"""
    with strangers.installed(tmp_path, "strangers_blocking", source, imu_sources=entries):
        block = importlib.import_module("strangers_blocking").block
        plugin_guard.guard_of(SOURCES, "blocking", sink)
        plugin_guard.guard_of(SOURCES, "blocking", other)
        block(lambda: "blocks the event loop" in caplog.text)
        label = "IMU source 'blocking' of strangers-parts"
        assert f"{label} blocks the event loop, and all services of this process, at " in caplog.text
        await until(lambda: bool(sink.last and other.last))
        assert re.fullmatch(
            rf"{label} has blocked the event loop for [\d.]+ s at strangers_blocking.py:[34] in block: it .*",
            sink.last,
        )
        assert other.last == sink.last
        await until(lambda: not (sink.shown or other.shown))

        called = find_culprit_in(block)
        assert called == ("strangers_blocking", "strangers_blocking.py:3 in block", ""), (
            "also below its calls"
        )


@pytest.mark.wall_time
async def test_own_service_that_blocks_the_loop_for_longer_is_named(
    sink: Sink, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    for name in ("STALL_S", "OWN_STALL_S"):
        monkeypatch.setattr(plugin_guard, name, 0.05)
    monkeypatch.setattr(plugin_guard, "STALL_PERIOD_S", 0.001)
    module = types.ModuleType("pointit.services.flooded.service")
    exec("def block(stop):\n    while not stop():\n        pass", vars(module))  # noqa: S102 - code by that name
    plugin_guard.watch_for_stalls(module.__name__, "flooded", sink, is_service=True)
    module.block(lambda: "flooded blocks the event loop" in caplog.text)
    await until(lambda: bool(sink.last))
    assert sink.last.startswith("flooded has blocked the event loop for ")
    assert sink.last.endswith(" in block: report this place")


def test_blocking_import_is_that_of_its_importer() -> None:
    """A plug-in of another package loads modules of the package of a service."""
    packages = {"pointit.services.flooded", "strangers"}
    found: list[plugin_guard.BlockingCode | None] = []
    look = (
        "import sys; from pointit.runtime.service import plugin_guard\n"
        f"found(plugin_guard.find_blocking_code(sys._getframe(), {packages}))"
    )

    def load(importer: str) -> None:
        module = types.ModuleType("pointit.services.flooded.serial_output")
        vars(module).update(found=found.append)
        caller = types.ModuleType(importer)
        vars(caller).update(run=lambda: exec(compile(look, "serial_output.py", "exec"), vars(module)))  # noqa: S102
        exec("def begin():\n    run()", vars(caller))  # noqa: S102
        caller.begin()

    load("strangers.driver")
    load("somebody.else")
    assert found == [
        plugin_guard.BlockingCode(
            "strangers", "<string>:2 in begin", "pointit.services.flooded.serial_output"
        ),
        None,
    ]


def find_culprit_in(block: Callable[[Callable[[], object]], None]) -> plugin_guard.BlockingCode | None:
    found: list[plugin_guard.BlockingCode | None] = []

    def look() -> bool:
        found.append(plugin_guard.find_blocking_code(sys._getframe(), {"strangers_blocking"}))
        return True

    block(look)
    return found[0]


def test_call_that_raises_is_reported_until_it_works(guard: PluginGuard, sink: Sink) -> None:
    assert guard.call("show", lambda: int("r")) is None
    assert sink.shown == {
        "part 'mine' of strangers: show": "part 'mine' of strangers: show failed (ValueError: invalid "
        "literal for int() with base 10: 'r'): update or remove it"
    }
    assert guard.call("light_s", lambda: 0.5) == 0.5
    assert len(sink.shown) == 1
    assert guard.call("show", lambda: 7) == 7
    assert not sink.shown


def test_calls_that_raise_for_each_frame_are_logged_rarely(
    guard: PluginGuard, sink: Sink, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def lost(frame: int) -> None:
        raise ConnectionError(f"port lost at frame {frame}")

    def show(first: int) -> None:
        for frame in range(first, first + 60):
            guard.call("light_s", lambda: 1 // 0)  # pyrefly: ignore[division-by-zero]
            guard.call("show", functools.partial(lost, frame))

    show(0)
    assert [record.getMessage().partition(" failed")[0] for record in caplog.records] == list(sink.shown)
    assert "frame 59" in sink.shown["part 'mine' of strangers: show"]  # health has the newest
    monkeypatch.setattr(plugin_guard, "LOG_PERIOD_S", 0.0)
    show(60)
    assert len(caplog.records) == 2 + 120


def test_plugin_that_cannot_be_created_is_a_configuration_mistake(guard: PluginGuard) -> None:
    def make(error: Exception) -> None:
        raise error

    with pytest.raises(ConfigError, match=r"mine' of strangers cannot be started \(KeyError: 'a'\); update"):
        guard.made(lambda: make(KeyError("a")))
    with pytest.raises(ConfigError, match="no port"):
        guard.made(lambda: make(ConfigError("no port")))


MODULE = """
from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import Plugin

class Mine(Config):
    address: str = ""
    speed: int = 3

MINE = Plugin(summary="my own", config=Mine, argument="address", example="HOST")
NUMBER = 7
"""
ENTRIES = """
mine = strangers_mine:MINE
number = strangers_mine:NUMBER
raising = strangers_raising:MINE
exiting = strangers_exiting:MINE
lacking = strangers_lacking:MINE [ble]
"""


@pytest.fixture
def parts(tmp_path: Path) -> Iterator[PluginGroup[Plugin]]:
    """Yield the plug-ins of a package that is installed for this test."""
    (tmp_path / "strangers_raising.py").write_text("open(f'{__file__}.imported', 'w').close()\n1 / 0\n")
    (tmp_path / "strangers_exiting.py").write_text("import sys\nsys.exit('no such device')\n")
    (tmp_path / "strangers_lacking.py").write_text("import a_library_that_is_absent\n")
    with strangers.installed(tmp_path, "strangers_mine", MODULE, test_parts=ENTRIES):
        yield PluginGroup("pointit.test_parts", Plugin, "part")


def test_plugin_of_another_package_is_chosen_and_validated(parts: PluginGroup[Plugin]) -> None:
    assert parts.names == ("exiting", "lacking", "mine", "number", "raising")
    assert parts.package("mine") == "strangers-parts"
    name, chosen = parts.choose("mine:[::1]:80")
    assert chosen == {"address": "[::1]:80"}
    config = parts.validate(name, chosen | {"speed": 5})
    assert config.model_dump() == {"address": "[::1]:80", "speed": 5}
    with pytest.raises(ValueError, match="no parameter sped; did you mean speed"):
        parts.validate(name, {"sped": 5})


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("absent", "no part 'absent' is installed; there are exiting, lacking, mine, number, raising"),
        ("number", "part 'number': strangers_mine:NUMBER is no Plugin"),
        ("raising", r"'raising' of strangers-parts cannot be imported \(ZeroDivisionError: .*\); update"),
        ("exiting", r"'exiting' of strangers-parts cannot be imported \(SystemExit: no such .*\); update"),
        ("lacking", r"of strangers-parts cannot be imported \(.*\); install strangers-parts\[ble\]"),
        ("mine:", "write mine:HOST"),
    ],
)
def test_unusable_plugin_is_refused_in_one_sentence(
    parts: PluginGroup[Plugin], text: str, sentence: str
) -> None:
    with pytest.raises(ConfigError, match=sentence):
        parts.choose(text)


def install(name: str, entry: str, folder: Path) -> None:
    info = folder / f"{name}-2.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 2.0\n")
    (info / "entry_points.txt").write_text(f"[pointit.test_parts]\n{entry}\n")


def test_name_that_two_packages_use_is_refused_alone(parts: PluginGroup[Plugin], tmp_path: Path) -> None:
    install("others", "number = others:NUMBER", tmp_path)
    with pytest.raises(ConfigError, match="is in two packages: uninstall others or strangers-parts"):
        parts.get("number")
    assert parts.names == ("exiting", "lacking", "mine", "number", "raising")
    assert parts.get("mine").summary == "my own"
    assert [*parts.configs()] == ["mine"]


class ServiceConfig(PluginConfig):
    number: int = 3

    @classmethod
    def plugins(cls) -> PluginGroup[Any]:
        return PluginGroup("pointit.test_parts", Plugin, "part")


@pytest.mark.usefixtures("parts")
def test_plugin_with_the_name_of_a_parameter_is_refused() -> None:
    config = ServiceConfig(number=4)  # of the service
    assert [*config.sections()] == ["mine"]
    with pytest.raises(ConfigError, match="part 'number' of strangers-parts has the name of a parameter"):
        config.section("number")
    assert config.section("mine").model_dump() == {"address": "", "speed": 3}


class Listening:
    NAME = "listening"
    SCOPE = "site"
    SEVERAL = False
    CONFIG = ServiceConfig


@pytest.mark.parametrize(
    ("arguments", "others"),
    [
        (["--number", "4", "--mine.speed", "5"], 0),
        (["--mine.sped", "5"], 1),  # the error suggests an option
        (["--help"], 1),
        (["-h"], 1),
    ],
)
def test_process_imports_only_plugins_that_its_arguments_name(
    parts: PluginGroup[Plugin], tmp_path: Path, arguments: list[str], others: int
) -> None:
    command = service_command(cast("Any", Listening))
    assert "raising" in parts.names
    with contextlib.suppress(click.exceptions.Exit, click.NoSuchOption):
        command.make_context("listening", arguments, help_option_names=["-h", "--help"])
    assert len(list(tmp_path.glob("*.imported"))) == others


def test_unknown_driver_is_refused_with_its_entry_point_group() -> None:
    sentence = (
        "use one of ros2, sim, vda5050; another one comes from a package with an entry point 'turtle' of "
        "pointit.robots, or is in pyproject.toml: then run scripts/setup"
    )
    with pytest.raises(ValidationError, match=sentence):
        RobotConfig(driver="turtle")
    with pytest.raises(ConfigError, match=r"no robot driver .turtle. is installed; there are ros2, sim, "):
        GROUPS["robot"].get("turtle")


def test_installed_wheel_names_no_script_of_a_checkout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(installed, "_SETUP", tmp_path / "setup")
    with pytest.raises(ValidationError, match=r"entry point 'turtle' of pointit.robots \["):
        RobotConfig(driver="turtle")


def test_plug_in_of_another_kind_is_named_with_its_package(tmp_path: Path) -> None:
    with strangers.installed(tmp_path, "strangers_kinds", "", robots="rover = strangers_kinds:ROVER"):
        clause = "; 'rover' of strangers-parts is of another kind, pointit.robots"
        with pytest.raises(ValidationError, match=clause):
            ImuBridgeConfig(source="rover")
        with pytest.raises(ValidationError, match=clause):
            SelectorConfig(method="rover")
        with pytest.raises(ValueError, match=f"use one of none, adalight, .*{clause}"):
            validate_output({"kind": "rover"})
