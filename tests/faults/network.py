"""Hosts on one machine, each a network namespace, and the wire between them, which can be made bad.

Every packet between two hosts is forwarded by a third namespace, the wire: there it is lost, held up or
queued, so that both ends have nothing but TCP (and Zenoh) to find out. Host A is this machine's own
namespace: the test itself looks on from there.
"""

import contextlib
import functools
import os
import shutil
import subprocess
import sys
from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.support.commands import Command, Commands, without_page

PREFIX = "pointit-fault-"
"""Prefix of our namespaces. The id of the process that made one follows."""
BLOCKS = range(256)
"""Blocks of addresses for tests of networks (RFC 2544), 198.18.N.0/24."""
WIRE = "wire"
ALL = 100
"""Percent."""


@functools.cache
def lacking() -> str:
    """Return the reason why no network can be made here, or `""` if there can."""
    if not sys.platform.startswith("linux") or os.geteuid() != 0:
        return "needs root on Linux, to make network namespaces"
    missing = [tool for tool in ("ip", "nft", "tc", "unshare") if shutil.which(tool) is None]
    if missing:
        return f"needs {' and '.join(missing)} (packages iproute2, nftables, util-linux)"
    name = f"{PREFIX}{os.getpid()}-try"
    try:
        _run("ip", "netns", "add", name)
        device = f"pit-{os.getpid()}"  # another suite may try at the same time
        _run("ip", "link", "add", device, "type", "veth", "peer", "name", "eth0", "netns", name)
        _run("ip", "netns", "exec", name, "nft", "add table inet faults")
    except RuntimeError as error:
        return f"may make no network here: {error}"
    finally:
        _try("ip", "netns", "del", name)
    return ""


def network_or_skip() -> None:
    if lacking():
        pytest.skip(lacking())


@dataclass(frozen=True)
class Host:
    """A namespace with one way out."""

    name: str
    address: str
    namespace: str
    """Empty: this machine's own."""

    @property
    def socket(self) -> str:
        return f"to-{self.name}"

    def arguments(self, *command: str) -> list[str]:
        """Return `command` as it is run there, on a machine of that name."""
        if not self.namespace:
            return list(command)
        named = ["unshare", "--uts", "sh", "-c", 'hostname "$0"; exec "$@"', self.name]
        return ["ip", "netns", "exec", self.namespace, *named, *command]

    def pointit(self, commands: Commands, *arguments: str, environment: Mapping[str, str]) -> Command:
        program = [sys.executable, "-m", "pointit"]
        return commands.run(self.arguments(*program, *without_page(arguments)), environment)


@dataclass
class Network:
    """Hosts, and the wire that all their packets go through."""

    block: int
    hosts: dict[str, Host] = field(default_factory=dict[str, Host])

    @property
    def wire(self) -> str:
        return f"{PREFIX}{os.getpid()}-{WIRE}"

    def join(self, name: str, *, here: bool = False) -> Host:
        """Make a host that the wire connects with all others; `here`: of this machine's own namespace."""
        number = 4 * len(self.hosts)
        mine = f"198.18.{self.block}.{number + 1}"
        gate = f"198.18.{self.block}.{number + 2}"
        namespace = "" if here else f"{PREFIX}{os.getpid()}-{name}"
        host = self.hosts[name] = Host(name, mine, namespace)
        device = f"pit{self.block}" if here else "eth0"
        if not here:
            _run("ip", "netns", "add", namespace)
            self._settings(namespace)
            _run("ip", "-n", namespace, "link", "set", "lo", "up")
        inside = ["-n", namespace] if namespace else []
        peer = ["peer", "name", host.socket, "netns", self.wire]
        _run("ip", *inside, "link", "add", device, "type", "veth", *peer)
        _run("ip", *inside, "address", "add", f"{mine}/30", "dev", device)
        _run("ip", *inside, "link", "set", "dev", device, "up")
        self._ip("address", "add", f"{gate}/30", "dev", host.socket)
        self._ip("link", "set", "dev", host.socket, "up")
        # `cubic` is what most machines have; this one's own is left alone
        where = f"198.18.{self.block}.0/24" if here else "default"
        route = [where, "via", gate, "dev", device, "metric", "9", "congctl", "cubic"]
        _run("ip", *inside, "route", "add", *route)
        return host

    def cut(self, host: Host) -> None:
        """Unplug the host's cable."""
        self._ip("link", "set", "dev", host.socket, "down")

    def lose(self, host: Host, percent: int, *, up: bool = True, down: bool = True) -> None:
        """Lose so many of the packets from the host (`up`) and to it (`down`), silently and at random."""
        what = "drop" if percent == ALL else f"numgen random mod 100 < {percent} drop"
        rules = [f"iif {host.socket} {what}"] * up + [f"oif {host.socket} {what}"] * down
        chain = "type filter hook forward priority 0;"
        lines = ["table inet faults {", "chain forward {", chain, *rules, "}", "}"]
        _run(*self._in_wire, "nft", "\n".join(lines))

    def narrow(self, host: Host, kbit: int) -> None:
        """Limit the rate to the host to `kbit` a second. The excess waits for up to 0.4 s."""
        limit = ["rate", f"{kbit}kbit", "burst", "4kb", "latency", "400ms"]
        _run("tc", "-n", self.wire, "qdisc", "add", "dev", host.socket, "root", "tbf", *limit)

    def clear(self) -> None:
        _try(*self._in_wire, "nft", "delete table inet faults")
        for host in self.hosts.values():
            _try("ip", "-n", self.wire, "link", "set", "dev", host.socket, "up")
            _try("tc", "-n", self.wire, "qdisc", "del", "dev", host.socket, "root")

    def sent_bytes(self, host: Host) -> int:
        file = f"/sys/class/net/{host.socket}/statistics/tx_bytes"
        return int(_run(*self._in_wire, "cat", file))

    def open(self) -> None:
        _run("ip", "netns", "add", self.wire)
        self._settings(self.wire)

    def close(self) -> None:
        """Remove everything. Processes that still run there lose their network."""
        self.clear()
        for host in self.hosts.values():
            if not host.namespace:
                _try("ip", "link", "del", f"pit{self.block}")
        for name in _namespaces():
            if name.startswith(f"{PREFIX}{os.getpid()}-"):
                _run("ip", "netns", "del", name)

    def _settings(self, namespace: str) -> None:
        for setting in ("ip_forward=1", "conf.all.rp_filter=0", "conf.default.rp_filter=0"):
            _run("ip", "netns", "exec", namespace, "sysctl", "-q", "-w", f"net.ipv4.{setting}")

    def _ip(self, *arguments: str) -> None:
        _run("ip", "-n", self.wire, *arguments)

    @property
    def _in_wire(self) -> list[str]:
        return ["ip", "netns", "exec", self.wire]


@contextlib.contextmanager
def network() -> Generator[Network]:
    """Yield a wire without hosts, and remove everything at the end, also the remains of aborted tests."""
    for name in _namespaces():
        if name.startswith(PREFIX) and not Path(f"/proc/{name.removeprefix(PREFIX).split('-')[0]}").exists():
            _try("ip", "netns", "del", name)
    routes = _run("ip", "route")
    block = next(number for number in BLOCKS if f"198.18.{number}." not in routes)
    made = Network(block)
    try:
        made.open()
        yield made
    finally:
        made.close()


def _namespaces() -> list[str]:
    return [line.split()[0] for line in _run("ip", "netns", "list").splitlines() if line]


def _try(*command: str) -> None:
    with contextlib.suppress(RuntimeError):
        _run(*command)


def _run(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    if done.returncode:
        raise RuntimeError(f"`{' '.join(command)}`: {done.stderr.strip()}")
    return done.stdout
