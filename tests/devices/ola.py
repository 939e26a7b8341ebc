"""OLA, an independent receiver of E1.31 and Art-Net, on a network of its own, for tests that send to it."""

import asyncio
import contextlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.support.pace import Patience

PREFIX = "pointit-ola-"
BLOCKS = range(256)
"""Blocks of addresses for tests of networks (RFC 2544), 198.19.N.0/30."""
UNIVERSES = 3
ARTNET_AT = 16
"""OLA's number of Art-Net's universe 0: it takes the rest of a division by 16. Those of E1.31 are its own."""
CONFIGS = {
    "artnet": "enabled = true\nip = {address}\nshort_name = ola\nlong_name = OLA in a test",
    "e131": "enabled = true\nip = {address}\ninput_ports = 3\noutput_ports = 0",
    "port": "11-1-I-0 = 1\n11-1-I-1 = 2\n11-1-I-2 = 3\n2-1-I-0 = 16\n2-1-I-1 = 17\n2-1-I-2 = 18",
}
"""Inputs of both protocols, each on a universe of OLA."""
UNUSED = (
    *("dummy", "espnet", "ftdidmx", "gpio", "karate", "kinet", "milinst", "nanoleaf", "opendmx", "osc"),
    *("openpixelcontrol", "pathport", "renard", "sandnet", "shownet", "spi", "stageprofi", "uartdmx"),
    *("usbdmx", "usbserial"),
)
"""Other protocols of OLA, which are switched off."""


class Ola:
    """A running OLA."""

    def __init__(self, address: str, gate: str, broadcast: str) -> None:
        self.address = address
        self.gate = gate
        """This machine's address in its network."""
        self.broadcast = broadcast
        self._client = httpx.AsyncClient(base_url=f"http://{address}:9090", trust_env=False)

    async def slots(self, universe: int) -> bytes:
        """Return the values that OLA has in a universe."""
        answer: dict[str, Any] = (await self._client.get("/get_dmx", params={"u": universe})).json()
        return bytes(answer["dmx"])

    async def until(self, universe: int, condition: Callable[[bytes], bool]) -> bytes:
        """Wait for `condition` of a universe, and return its slots."""
        patience = Patience(30.0)
        while not condition(slots := await self.slots(universe)):
            assert not patience.is_over(), f"universe {universe} has {slots[:60].hex()} ..."
            await asyncio.sleep(0.005)
        return slots

    async def close(self) -> None:
        """Close the connection."""
        await self._client.aclose()


@contextlib.contextmanager
def running_ola() -> Generator[tuple[str, str, str]]:
    """Yield address, gate and broadcast address of an OLA that is ready; skip where there can be none."""
    if not sys.platform.startswith("linux") or os.geteuid() != 0:
        pytest.skip("needs root on Linux, to make a network namespace for OLA")
    if missing := [tool for tool in ("ip", "setpriv", "olad") if shutil.which(tool) is None]:
        pytest.skip(f"needs {', '.join(missing)} (packages iproute2, util-linux, ola)")
    routes = _run("ip", "route")
    block = next(number for number in BLOCKS if f"198.19.{number}." not in routes)
    name = f"{PREFIX}{os.getpid()}"
    device = f"ola{os.getpid()}"
    gate, address, broadcast = (f"198.19.{block}.{last}" for last in (1, 2, 3))
    folder = Path(tempfile.mkdtemp())  # not pytest's, which only its owner enters
    _configure(folder, address)
    _run("ip", "netns", "add", name)
    process = None
    try:
        _run("ip", "link", "add", device, "type", "veth", "peer", "name", "eth0", "netns", name)
        _run("ip", "address", "add", f"{gate}/30", "broadcast", broadcast, "dev", device)
        _run("ip", "link", "set", device, "up")
        _run("ip", "-n", name, "address", "add", f"{address}/30", "broadcast", broadcast, "dev", "eth0")
        _run("ip", "-n", name, "link", "set", "lo", "up")
        _run("ip", "-n", name, "link", "set", "eth0", "up")
        _run("ip", "-n", name, "route", "add", "default", "via", gate)
        nobody = ("setpriv", "--reuid=nobody", "--regid=nogroup", "--clear-groups")  # it refuses to be root
        command = ("ip", "netns", "exec", name, *nobody, "olad", "--config-dir", f"{folder}")
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _wait_until_ready(process, address)
        yield address, gate, broadcast
    finally:
        if process is not None:
            process.terminate()
            process.wait(30)
        _run("ip", "netns", "del", name)  # the device goes with it
        shutil.rmtree(folder)


def _configure(folder: Path, address: str) -> None:
    for name in UNUSED:
        (folder / f"ola-{name}.conf").write_text("enabled = false\n", encoding="ascii")
    for name, text in CONFIGS.items():
        (folder / f"ola-{name}.conf").write_text(text.format(address=address) + "\n", encoding="ascii")
    for path in (folder, *folder.iterdir()):
        shutil.chown(path, "nobody")


def _wait_until_ready(process: "subprocess.Popen[bytes]", address: str) -> None:
    patience = Patience(60.0)
    with httpx.Client(trust_env=False) as client:
        while True:
            with contextlib.suppress(httpx.TransportError):
                answer = client.get(f"http://{address}:9090/get_dmx", params={"u": ARTNET_AT + UNIVERSES - 1})
                if not answer.json()["error"]:
                    return
            assert process.poll() is None, "olad has ended"
            assert not patience.is_over(), "olad is not ready"
            time.sleep(0.02)


def _run(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    if done.returncode:
        raise RuntimeError(f"`{' '.join(command)}`: {done.stderr.strip()}")
    return done.stdout
