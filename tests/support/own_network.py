"""A plugin (`-p tests.support.own_network`): each worker of pytest-xdist is in a network of its own.

There, ports, addresses and multicasts of a test meet no other test's: a browser, for example, gives up what
it loads when an address of its machine changes. Tests marked `index` are in the machine's network. So are
all tests if this process may not make a network.
"""

import ctypes
import os
import subprocess
import sys
from collections.abc import Generator

import pytest

NEW_NETWORK = 0x40000000
"""CLONE_NEWNET of Linux. `os.unshare` and `os.setns` came with Python 3.12."""
THIS = "/proc/thread-self/ns/net"
DEVICES = """
ip link set lo up
ip link add lan type veth peer name nowhere
ip link set nowhere up
ip address add 192.168.1.5/24 dev lan
ip link set lan up
ip route add default via 192.168.1.1
"""
"""Network with a local address and a route, as a machine in an office has them."""
_NETWORKS = pytest.StashKey[tuple[int, int]]()
"""Network of the machine and that of this process, as open files."""


def pytest_configure(config: pytest.Config) -> None:
    """Make the network, which all processes that tests start inherit."""
    if sys.platform != "linux" or not hasattr(config, "workerinput"):
        return
    machine = os.open(THIS, os.O_RDONLY)
    if ctypes.CDLL(None).unshare(NEW_NETWORK) == 0:
        subprocess.run(["sh", "-ec", DEVICES], check=True)  # noqa: S607 - any shell
        config.stash[_NETWORKS] = machine, os.open(THIS, os.O_RDONLY)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Run tests marked `index` in the machine's network."""
    networks = item.config.stash.get(_NETWORKS, None)
    if networks is None or item.get_closest_marker("index") is None:
        return (yield)
    machine, own = networks
    _enter(machine)
    try:
        return (yield)
    finally:
        _enter(own)


def _enter(network: int) -> None:
    if ctypes.CDLL(None).setns(network, NEW_NETWORK) != 0:
        message = "the network of the machine cannot be entered"
        raise OSError(message)
