"""Processes end soon, with a meaningful exit code, whatever they wait for."""

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import textwrap
import time
from collections.abc import Generator
from contextlib import contextmanager

import pytest

from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas.topics import SERVICE_ALIVE
from tests.support.bench import until
from tests.support.buses import free_port, router_process

SIGNALS = (signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.long))


@contextmanager
def process(*arguments: str) -> Generator[subprocess.Popen[str]]:
    """Run Python with `arguments`; kill it if it is still there at the end."""
    child = subprocess.Popen(
        [sys.executable, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        yield child
    finally:
        child.kill()
        child.communicate(timeout=30)


def line_with(child: subprocess.Popen[str], what: str) -> str:
    assert child.stderr is not None
    for line in child.stderr:
        if what in line:
            return line
    raise AssertionError(f"ended without saying {what!r}")


def ended(child: subprocess.Popen[str], number: int) -> int:
    """Send a signal; return the exit code, which is 1 if the process had to cut itself off."""
    child.send_signal(number)
    return child.wait(60)


def pointing(endpoint: str) -> tuple[str, ...]:
    return ("-m", "pointit.services", "pointing", "--user", "anna", "--connect", endpoint)


@pytest.mark.parametrize("number", SIGNALS)
def test_service_waiting_for_its_router_ends_on_a_signal(number: int) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with process(*pointing(endpoint)) as child:
        entry = json.loads(line_with(child, "nobody answers"))
        assert endpoint in entry["message"]
        assert ended(child, number) == 0
        assert child.stderr is not None
        assert "Traceback" not in child.stderr.read()


def test_a_process_ends_while_a_listener_never_answers() -> None:
    mute = socket.create_server(("127.0.0.1", 0))
    with mute, process(*pointing(f"tcp/127.0.0.1:{mute.getsockname()[1]}")) as child:
        line_with(child, "nobody answers")
        assert ended(child, signal.SIGINT) == 0


@pytest.mark.parametrize("number", SIGNALS)
async def test_running_service_ends_on_a_signal_and_is_gone(number: int) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    bus = await ZenohBus.open(Link(listen=(endpoint,)))
    told: list[tuple[str, bool]] = []
    bus.watch(SERVICE_ALIVE, lambda name, *, present: told.append((name, present)))
    with process(*pointing(endpoint)) as child:
        await until(lambda: told == [("pointing.anna", True)], 15)
        assert await asyncio.to_thread(ended, child, number) == 0
        await until(lambda: told[1:] == [("pointing.anna", False)])
    await bus.close()


async def test_service_ends_while_its_router_never_answers() -> None:
    async with router_process() as router:
        bus = await ZenohBus.open(Link(connect=(router.endpoint,)), patience_s=30)
        told: list[tuple[str, bool]] = []
        bus.watch(SERVICE_ALIVE, lambda name, *, present: told.append((name, present)))
        with process(*pointing(router.endpoint)) as child:
            await until(lambda: bool(told), 15)
            await bus.close()
            router.stop()
            await asyncio.to_thread(line_with, child, "is lost")
            port = int(router.endpoint.rpartition(":")[2])
            with socket.create_server(("127.0.0.1", port)) as mute:
                mute.settimeout(60)
                tried, _ = await asyncio.to_thread(mute.accept)
                with tried:
                    assert await asyncio.to_thread(ended, child, signal.SIGTERM) == 0


BODY = """
import asyncio, sys
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.runtime.zenoh.session import Link
from pointit.schemas import Done, UserProfile, ButtonEvent
from pointit.schemas.topics import *

async def done(query, name): return Done()

async def main():
    bus = await ZenohBus.open(Link(listen=("{endpoint}",)))
    for topic in (IMU, BUTTON, PROFILE):
        bus.subscribe(topic, lambda message, name: None)
    bus.publisher(IMU, "a")
    bus.publisher(BUTTON, "a").put(ButtonEvent(stamp_ns=1))
    bus.publisher(PROFILE, "a").put(UserProfile(stamp_ns=1))
    bus.serve(SET_BRIGHTNESS, done)
    bus.announce(USER_ALIVE, "a")
    bus.watch(USER_ALIVE, lambda name, **_: None)
    await asyncio.sleep(0.3)
    {end}

asyncio.run(main())
"""


@pytest.mark.parametrize(
    ("end", "code"), [("return", 0), ("sys.exit(3)", 3), ("raise ValueError", 1), ("await bus.close()", 0)]
)
def test_a_process_that_forgets_to_close_ends_all_the_same(end: str, code: int) -> None:
    script = textwrap.dedent(BODY).format(endpoint=f"tcp/127.0.0.1:{free_port()}", end=end)
    with process("-c", script) as child:
        assert child.wait(60) == code


STUBBORN = """
import asyncio, os, sys
from pointit.runtime.service import process as ending
ending.END_TIMEOUT_S = 0.5
os.getloadavg = lambda: (float(sys.argv[1]) * os.cpu_count(), 0.0, 0.0)

async def work():
    print("ready", flush=True)
    while True:
        try:
            await asyncio.Event().wait()
        except asyncio.CancelledError:
            pass

ending.run_until_shutdown(work())
"""


@pytest.mark.parametrize(("crowding", "within_s"), [(0.2, 0.5), (2.0, 1.0)])
def test_stuck_task_is_killed_later_on_a_crowded_machine(crowding: float, within_s: float) -> None:
    with process("-c", STUBBORN, str(crowding)) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "ready\n"
        began_s = time.monotonic()
        assert ended(child, signal.SIGTERM) == 1
        assert time.monotonic() - began_s >= within_s
        assert child.stderr is not None
        assert f"Error: did not end within {within_s:.1f} s: " in (said := child.stderr.read())
        assert "main" in said


THREAD = """
import asyncio, threading
from pointit.runtime.service import process as ending
ending.END_TIMEOUT_S = 0.5

async def work():
    asyncio.get_running_loop().run_in_executor(None, threading.Event().wait)
    print("ready", flush=True)
    await asyncio.Event().wait()

ending.run_until_shutdown(work())
"""


def test_a_thread_that_does_not_end_is_cut_off() -> None:
    with process("-c", THREAD) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "ready\n"
        assert ended(child, signal.SIGINT) == 1


LATE = """
import asyncio, os, signal
from pointit.runtime.service.process import run_until_shutdown
signal.signal(signal.SIGINT, signal.SIG_DFL)  # as `pointit` does

async def work():
    asyncio.get_running_loop().call_soon(os.kill, os.getpid(), signal.SIGINT)
    await asyncio.Event().wait()

code = run_until_shutdown(work())
os.kill(os.getpid(), signal.SIGINT)
print("summary")
raise SystemExit(code)
"""


def test_ctrl_c_once_more_does_not_stop_the_summary() -> None:
    with process("-c", LATE) as child:
        said, _ = child.communicate(timeout=60)
        assert (said, child.returncode) == ("summary\n", 0)


@pytest.mark.parametrize("number", SIGNALS)
def test_router_prints_its_endpoint_and_ends_on_a_signal(number: int) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with process("-m", "pointit", "router", "--listen", endpoint) as router:
        assert router.stdout is not None
        assert endpoint in router.stdout.readline()
        assert ended(router, number) == 0
