"""Every address of the page that is printed is one at which it listens, whatever the network is like.

Addresses of loopback stand for those of interfaces: the system lets a process listen at them, and it refuses
connections to those at which nobody listens.
"""

import socket
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from starlette.applications import Starlette

from pointit.bridges.web.server.lan import Lan
from pointit.cli.browser_window import PagePresence
from pointit.cli.page import DashboardLines, RunPage
from pointit.launch import page as page_of_a_run
from pointit.launch.page import Page, is_listening, lan_lines, page_of
from pointit.launch.plan.launches import Settings
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.host import windows_subsystem
from pointit.runtime.host.windows_subsystem import lan_advice
from pointit.schemas.topics import SERVICE_ALIVE
from tests.integration.web.pages import serving
from tests.support.bench import Bench
from tests.support.buses import free_port

WIRED = "127.0.0.7"
WIRELESS = "127.0.0.8"
IPV6 = "::1"
WSL = "Linux version 5.15.90.1-microsoft-standard-WSL2"

NETWORKS: dict[str, tuple[list[str], dict[str, Any]]] = {
    "default route": ([WIRED], {}),
    "several interfaces": ([WIRED, WIRELESS], {}),
    "IPv6 alone": ([IPV6], {}),
    "any port": ([WIRED], {"lan_port": 0}),
    "chosen interface": ([WIRED, WIRELESS], {"lan_address": WIRELESS}),
    "chosen address of IPv6": ([WIRED], {"lan_address": "0:0:0:0:0:0:0:1"}),
    "chosen address in brackets": ([WIRED], {"lan_address": "[::1]"}),
    "another machine's address": ([WIRED], {"lan_address": "192.0.2.77"}),
    "no network": ([], {}),
}
"""Addresses of the machine, as `lan_addresses` finds them, and parameters of the page."""


def machine(monkeypatch: pytest.MonkeyPatch, addresses: list[str]) -> None:
    monkeypatch.setattr(page_of_a_run, "lan_addresses", lambda: addresses)
    monkeypatch.setattr(page_of_a_run, "LAN_PORT", free_port())


def page_in(**asked: Any) -> Page:
    return page_of(Settings(), asked={"port": 0, "lan": True, **asked})


def address_in(lines: list[str]) -> str:
    """Return the address that is printed as one of the page, or `""`."""
    for line in lines:
        if "is open to the local network, at " in line:
            return line.rpartition(" at ")[2].partition(" (")[0].rstrip("/")
    return ""


async def open_door(page: Page, addresses: list[str]) -> Lan:
    door = Lan(page.config, "lab", Starlette(), addresses=lambda: addresses, advice=lambda _: "")
    try:
        await door.open()
    except RefusedError:
        assert door.url == ""
    return door


@pytest.mark.parametrize("network", NETWORKS)
@pytest.mark.parametrize("is_port_taken", [False, True])
async def test_printed_address_is_that_of_the_listener(
    network: str, *, is_port_taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    addresses, parameters = NETWORKS[network]
    machine(monkeypatch, addresses)
    with ExitStack() as stack:
        if is_port_taken:
            for address in addresses:
                family = socket.AF_INET6 if ":" in address else socket.AF_INET
                port = page_of_a_run.LAN_PORT
                stack.enter_context(socket.create_server((address, port), family=family))
        page = page_in(**parameters)
        assert address_in(lan_lines(page.lan_url, None, "")) == "", "before it listens"

        door = await open_door(page, addresses)
        try:
            printed = address_in(lan_lines(page.lan_url, None, ""))
            assert printed == door.url
            assert printed == "" or is_listening(printed)
        finally:
            await door.close()
    assert address_in(lan_lines(page.lan_url, None, "")) == "", "after it was closed"


@pytest.mark.parametrize("address", ["wlan0", "10.0.0.7:80", "0.0.0.0"])  # noqa: S104 - refused
def test_address_that_is_none_is_refused_before_the_start(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine(monkeypatch, [WIRED])
    with pytest.raises(ConfigError, match="lan_address: "):
        page_in(lan_address=address)


async def test_address_that_has_gone_since_is_not_printed(monkeypatch: pytest.MonkeyPatch) -> None:
    machine(monkeypatch, [WIRED])
    page = page_in()
    door = await open_door(page, [WIRELESS])
    try:
        (line,) = lan_lines(page.lan_url, None, "")
    finally:
        await door.close()
    port = page.config.lan_port
    assert line.startswith("--lan: not open to the local network: ")
    assert f"https://{WIRED}:{port}" in line
    assert "token" not in line


async def test_page_listens_in_the_network_when_it_is_present(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine(monkeypatch, [WIRED])
    page = page_in(lan_address=WIRED)
    seen: list[bool] = []

    def on_presence(name: str, *, present: bool) -> None:
        if name == "web" and present:
            seen.append(is_listening(page.lan_url))

    with ExitStack() as stack:
        stack.callback(bench.bus.watch(SERVICE_ALIVE, on_presence).close)
        async with serving(bench, lan=True, lan_address=WIRED, lan_port=page.config.lan_port):
            assert seen == [True]
    assert not is_listening(page.lan_url)


async def test_dashboard_prints_its_addresses_once_it_is_present(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    machine(monkeypatch, [WIRED])
    page = page_in(lan_address=WIRED)
    lines = DashboardLines(url=page.url, lan_url=page.lan_url, file=None, lan_advice="")
    with ExitStack() as stack:
        stack.callback(PagePresence(bench.bus, "web", lines.print).close)
        assert capsys.readouterr().out == ""
        port = page.config.port
        async with serving(bench, port=port, lan=True, lan_address=WIRED, lan_port=page.config.lan_port):
            printed = capsys.readouterr().out.splitlines()
    own, network = printed
    assert own == f"page: http://127.0.0.1:{port}/"
    parts = urlsplit(address_in([network]))
    assert (parts.hostname, parts.port) == (WIRED, page.config.lan_port)


@pytest.mark.parametrize(
    ("mode", "words"), [("nat", "only Windows reaches"), ("mirrored", "permit the port")]
)
async def test_linux_in_windows_is_explained_beside_the_address(
    mode: str, words: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    kernel = tmp_path / "version"
    kernel.write_text(WSL)
    monkeypatch.setattr(windows_subsystem, "_KERNEL", kernel)
    monkeypatch.setattr(windows_subsystem, "networking_mode", lambda: mode)
    machine(monkeypatch, [WIRED])
    page = page_in()
    beside = RunPage(page)
    beside.launch()
    door = await open_door(page, [WIRED])
    try:
        lines = beside.greeting(is_drawn=True)
    finally:
        await door.close()
    assert address_in([*lines]) == f"https://{WIRED}:{page.config.lan_port}"
    assert words in lines[-1]
    assert lan_advice(page.config.lan_port) in lines[-1]


def test_scan_for_phones_is_not_printed_when_nothing_listens(monkeypatch: pytest.MonkeyPatch) -> None:
    machine(monkeypatch, [WIRED])
    page = page_in(scan_token="a scan's")  # noqa: S106 - of nothing
    assert page.scan_url.startswith("https://")
    lines = RunPage(page).greeting(is_drawn=True)
    assert not [line for line in lines if "map this room" in line]


def test_address_of_another_machine_that_answers_is_not_ours(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        connect = socket.socket.connect

        def answer(self: socket.socket, _address: object) -> None:
            """Connect to this machine in place of the other one, as a transparent proxy does."""
            connect(self, ("127.0.0.1", port))

        monkeypatch.setattr(socket.socket, "connect", answer)
        assert is_listening(f"https://127.0.0.1:{port}/")
        assert not is_listening("https://203.0.113.7:8443/")
