"""Death of the bridge before and after each effect that it has: lamps have their state of before in the end.

An effect is a message to or from Home Assistant, or a step of writing a file. `kill -9` in between is what
happens to a process that has its effects up to one and no further ones.
"""

import asyncio
import gc
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import asynccontextmanager
from copy import deepcopy
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from pointit import run_virtually
from pointit.bridges.home_assistant import service
from pointit.runtime.service import service as runtime
from tests.support.bench import memory_bench, until
from tests.support.home_assistant import HomeSite, MemoryHome, config_of, start, thing

LAMP = "light.desk"
OTHER = "light.shelf"
BRIGHTNESS = {LAMP: 100, OTHER: 250}
"""The other lamp dims, since it cannot brighten by a fifth."""
REST_S = 5.0
"""Time after which a new process has done all that it does, in virtual time."""
MAX_EFFECTS = 200
NO_LIGHTS = '{"lights":{}}'
FILE_STEPS = ("mkdir", "touch", "write_bytes", "chmod", "replace", "unlink")
"""Functions of `Path` by which a file changes."""

Acts = Callable[[MemoryHome, HomeSite], Awaitable[None]]


class Process:
    """Effects of a process that dies after `lifetime` of them."""

    def __init__(self, lifetime: int) -> None:
        self.effects: list[str] = []
        self.death = asyncio.Event()
        self._lifetime = lifetime

    def is_alive(self, effect: str) -> bool:
        """Return True, and count the effect, if the process has it."""
        if len(self.effects) >= self._lifetime:
            self.death.set()
        if not self.death.is_set():
            self.effects.append(effect)
        return not self.death.is_set()

    def intercept_files(self, folder: Path, patch: pytest.MonkeyPatch) -> None:
        """Count the steps of writing a file below `folder`, of which a dead process has none."""

        def intercept(name: str) -> None:
            step = getattr(Path, name)

            def run(path: Path, *args: Any, **kwargs: Any) -> Any:
                if path.is_relative_to(folder):
                    if name == "write_bytes" and self.is_alive("half of write_bytes"):
                        step(path, args[0][: len(args[0]) // 2])
                    if not self.is_alive(name):
                        raise asyncio.CancelledError
                return step(path, *args, **kwargs)

            patch.setattr(Path, name, run)

        for name in FILE_STEPS:
            intercept(name)


def lit_home() -> MemoryHome:
    return MemoryHome({each: ("on", {"brightness": value}) for each, value in BRIGHTNESS.items()})


async def hover(home: MemoryHome, site: HomeSite) -> None:
    async with site.hovering("desk"):
        await until(lambda: brightness(home) != BRIGHTNESS[LAMP], what="the hover")
    await asyncio.sleep(REST_S)


async def flicker(home: MemoryHome, site: HomeSite) -> None:
    """Point past the lamps, which report late: names change faster than states."""
    home.report_delay_s = 0.7
    for name, duration_s in (("desk", 0.05), ("shelf", 0.3), ("desk", 0.45), ("shelf", 0.05), ("desk", 0.1)):
        async with site.hovering(name):
            await asyncio.sleep(duration_s)
    await asyncio.sleep(REST_S)


async def hover_slow_lamp(home: MemoryHome, site: HomeSite) -> None:
    home.latency_s = 0.3
    await hover(home, site)


async def switch_off(home: MemoryHome, site: HomeSite) -> None:
    async with site.hovering("desk"):
        await until(lambda: brightness(home) != BRIGHTNESS[LAMP], what="the hover")
        site.point("desk", on=False)
        await until(lambda: home.states[LAMP]["state"] == "off", what="the lamp to go off")
    await asyncio.sleep(REST_S)


async def restart_home(home: MemoryHome, site: HomeSite) -> None:
    async with site.hovering("desk"):
        await until(lambda: brightness(home) != BRIGHTNESS[LAMP], what="the hover")
        home.set(LAMP, "unavailable")
        home.disconnect()
        await asyncio.sleep(3.0)
        home.set(LAMP, "on", brightness=120)
    await asyncio.sleep(REST_S)


def brightness(home: MemoryHome, lamp: str = LAMP) -> Any:
    return home.states[lamp]["attributes"].get("brightness")


@asynccontextmanager
async def bridge(home: MemoryHome, folder: Path, process: Process) -> AsyncGenerator[HomeSite]:
    """Run a process of the bridge, and yield the site beside it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("POINTIT_STATE", str(folder))
        patch.setattr(service, "connected", home.connected)
        patch.setattr(runtime, "HEALTH_PERIOD_S", 10.0)
        process.intercept_files(folder, patch)
        home.is_alive = process.is_alive
        async with memory_bench() as bench:
            site = HomeSite(bench, thing("desk", LAMP), thing("shelf", OTHER))
            start(bench, config_of(folder.parent, 1))
            yield site


async def live(home: MemoryHome, folder: Path, acts: Acts, process: Process) -> None:
    """Run a process until `acts` have ended or it has died."""
    async with bridge(home, folder, process) as site:
        acting = asyncio.ensure_future(acts(home, site))
        dying = asyncio.create_task(process.death.wait())
        await asyncio.wait([acting, dying], return_when=asyncio.FIRST_COMPLETED)
        for task in (acting, dying):
            task.cancel()
        await asyncio.wait([acting, dying])
        if not acting.cancelled():
            acting.result()


def stored_lights(folder: Path) -> set[str]:
    return {"".join(path.read_text().split()) for path in folder.rglob("dimmed_lights.json")}


async def nothing(_home: MemoryHome, _site: HomeSite) -> None:
    await asyncio.sleep(REST_S)


async def check_restored(
    home: MemoryHome, folder: Path, before: Any, *processes: tuple[Acts, Process]
) -> None:
    """Run further processes, and check that the lamps are as before."""
    for acts, process in processes:
        if home.states[LAMP]["state"] == "unavailable":
            home.set(LAMP, "on", brightness=120)
        await live(home, folder, acts, process)
    if home.states[LAMP]["state"] == "off":  # it was switched: it returns when it is on again, at the latest
        home.act("turn_on", LAMP, {})
        await live(home, folder, nothing, Process(MAX_EFFECTS))
    assert home.states == before
    assert stored_lights(folder) <= {NO_LIGHTS}, "nothing is left to restore"


async def test_orderly_end_short_after_a_hover_leaves_nothing_to_restore(tmp_path: Path) -> None:
    home = lit_home()
    folder = tmp_path / "state"
    folder.mkdir()

    async def end_soon(home: MemoryHome, site: HomeSite) -> None:
        async with site.hovering("desk"):
            await until(lambda: brightness(home) != BRIGHTNESS[LAMP], what="the hover")
        await until(lambda: brightness(home) == BRIGHTNESS[LAMP], what="the lamp to return")
        await asyncio.sleep(0.5)

    await live(home, folder, end_soon, Process(MAX_EFFECTS))
    assert stored_lights(folder) == {NO_LIGHTS}, "a lamp that is set by hand meanwhile stays so"


async def test_orderly_end_during_a_hover_leaves_nothing_to_restore(tmp_path: Path) -> None:
    home = lit_home()
    folder = tmp_path / "state"
    folder.mkdir()
    async with bridge(home, folder, Process(MAX_EFFECTS)) as site, site.hovering("desk"):
        await until(lambda: brightness(home) != BRIGHTNESS[LAMP], what="the hover")
        await site._bench.stop()
    assert brightness(home) == BRIGHTNESS[LAMP]
    assert stored_lights(folder) == {NO_LIGHTS}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("acts", "next_acts", "is_killed_again"),
    [
        pytest.param(hover, nothing, False, id="hover"),
        pytest.param(hover, hover, False, id="hover before and after"),
        pytest.param(hover, hover, True, id="hover in two processes that are killed"),
        pytest.param(flicker, nothing, False, id="flickering hovers of lamps that report late"),
        pytest.param(hover_slow_lamp, hover, False, id="hover of a slow lamp"),
        pytest.param(switch_off, nothing, False, id="lamp that is switched off while hovered"),
        pytest.param(restart_home, nothing, False, id="restart of Home Assistant"),
    ],
)
def test_lamps_are_restored_after_a_kill_at_any_effect(
    acts: Acts, next_acts: Acts, *, is_killed_again: bool, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    changed: int = 0

    async def run(lifetime: int) -> Process:
        nonlocal changed
        home = lit_home()
        folder = tmp_path / f"{lifetime}" / "state"
        process = Process(lifetime)
        folder.mkdir(parents=True)
        before = deepcopy(home.states)
        await live(home, folder, acts, process)
        changed += process.death.is_set() and home.states != before
        again = [(next_acts, Process(lifetime))] if is_killed_again else []
        try:
            await check_restored(home, folder, before, *again, (next_acts, Process(MAX_EFFECTS)))
        except AssertionError as error:
            raise AssertionError(
                f"died after {lifetime} effects, the last: {process.effects[-3:]}"
            ) from error
        return process

    for lifetime in count():
        assert lifetime < MAX_EFFECTS
        if not run_virtually(run(lifetime)).death.is_set():
            break
    gc.collect()
    assert "messages of Home Assistant" not in caplog.text, "no task is left"
    assert changed, "some processes have to die while a lamp is changed"
