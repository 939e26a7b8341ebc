"""The machines of a load test: network namespaces with a cable for each link, or this machine's loopback.

A namespace lives as long as the processes in it. All of them end with this one, even if it is killed.
"""

import contextlib
import socket
import subprocess
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pointit.schemas.text import system_reason
from pointit_lab.loadtest.network.tree import Machine, router_of

PORT = 7447
UPLINK = "uplink"
"""Device of a machine towards its router's uplink."""
STEP_S = 10.0


@dataclass(frozen=True, kw_only=True)
class NamespaceTraffic:
    """Traffic of a link so far, as its lower end counts it."""

    up_bytes: int
    up_packets: int
    down_bytes: int
    down_packets: int


@dataclass
class NamespaceNetwork:
    """The machines, ready for processes."""

    machines: Sequence[Machine]
    scheme: str
    """`tcp` or `tls`."""
    lacking: str = ""
    """Reason why all machines are this one, or `""` if each is a namespace."""
    holders: list["subprocess.Popen[bytes]"] = field(default_factory=list["subprocess.Popen[bytes]"])
    _ports: dict[int, int] = field(default_factory=dict[int, int])

    def arguments(self, index: int, *command: str) -> list[str]:
        """Return `command` as it is run at a machine."""
        if self.lacking:
            return list(command)
        pid = self.holders[index].pid
        return ["nsenter", f"--net=/proc/{pid}/ns/net", "--", *command]

    def listen(self, index: int) -> str:
        """Return the address where a machine's router listens."""
        if self.lacking:
            return self._local_address(index)
        return f"{self.scheme}/0.0.0.0:{PORT}"

    def endpoint(self, index: int) -> str:
        """Return the address of the router that a machine's people join."""
        router = router_of(self.machines, index)
        if router == index:
            return self._local_address(router)
        return self.uplink(index)

    def uplink(self, index: int) -> str:
        """Return the address of the router above a machine that is not the root."""
        if self.lacking:
            return self._local_address(self.machines[index].uplink)
        address = _address(index, 2)
        return f"{self.scheme}/{address}:{PORT}"

    def addresses(self) -> list[str]:
        """Return all addresses at which a router is reached."""
        addresses = ["127.0.0.1"]
        if not self.lacking:
            addresses += [_address(index, 2) for index in range(1, len(self.machines))]
        return addresses

    def traffic(self) -> dict[int, NamespaceTraffic]:
        """Return the traffic of each link, by its lower machine's index. That of loopback is unknown."""
        if self.lacking:
            return {}
        lower = range(1, len(self.machines))
        return {index: self._traffic(index) for index in lower}

    def lay(self) -> None:
        """Make the namespaces and their cables.

        Raises:
            OSError: A program is missing, as on other systems than Linux.
            RuntimeError: The system forbids it.
        """
        # A namespace lives as long as a process in it. `sh` says an empty line when it is in; any other line
        # is an error of `unshare`.
        for _ in self.machines:
            holder = subprocess.Popen(
                ["unshare", "--net", "sh", "-c", "echo; exec cat"],  # noqa: S607 - ends with our end of its pipe
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                process_group=0,
            )
            self.holders.append(holder)
            line = b""
            if holder.stdout is not None:
                line = holder.stdout.readline().strip()
            if line:
                raise RuntimeError(line.decode(errors="replace"))

        # Every machine but the root has a cable to the one above. Each cable is a network of its own (/30).
        for index, machine in enumerate(self.machines):
            self._ip(index, "link", "set", "lo", "up")
            if not index:
                continue
            downlink = f"down{index}"
            upper_pid = str(self.holders[machine.uplink].pid)
            peer = ("peer", "name", downlink, "netns", upper_pid)
            self._ip(index, "link", "add", UPLINK, "type", "veth", *peer)
            for end_index, device, end in ((index, UPLINK, 1), (machine.uplink, downlink, 2)):
                address = f"{_address(index, end)}/30"
                self._ip(end_index, "address", "add", address, "dev", device)
                self._ip(end_index, "link", "set", "dev", device, "up")

    def close(self) -> None:
        """Remove the namespaces."""
        for holder in self.holders:
            holder.kill()
            holder.communicate()
        self.holders.clear()

    def _local_address(self, index: int) -> str:
        return f"{self.scheme}/127.0.0.1:{self._port(index)}"

    def _port(self, index: int) -> int:
        if not self.lacking:
            return PORT
        if index not in self._ports:
            self._ports[index] = free_port()
        return self._ports[index]

    def _ip(self, index: int, *arguments: str) -> None:
        command = self.arguments(index, "ip", *arguments)
        process = subprocess.run(  # noqa: S603 - `ip`, with our own names
            command, capture_output=True, text=True, check=False, timeout=STEP_S
        )
        if process.returncode:
            raise RuntimeError(process.stderr.strip())

    def _traffic(self, index: int) -> NamespaceTraffic:
        path = Path(f"/proc/{self.holders[index].pid}/net/dev")
        devices = path.read_text(encoding="ascii")
        # Eight columns of what was received, then eight of what was sent: bytes and packets are the first.
        _, _, row = devices.partition(f"{UPLINK}:")
        columns = row.split()
        return NamespaceTraffic(
            up_bytes=int(columns[8]),
            up_packets=int(columns[9]),
            down_bytes=int(columns[0]),
            down_packets=int(columns[1]),
        )


@contextlib.contextmanager
def network(machines: Sequence[Machine], scheme: str) -> Generator[NamespaceNetwork]:
    """Yield the machines as namespaces, or where the system permits none, as processes on loopback."""
    network = NamespaceNetwork(machines, scheme)
    try:
        network.lay()
    except (OSError, RuntimeError, subprocess.TimeoutExpired) as error:
        network.close()
        lacking = system_reason(error)
        if isinstance(error, FileNotFoundError):
            lacking = f"{error.filename} is not installed"
        network = NamespaceNetwork(machines, scheme, lacking=lacking)
    try:
        yield network
    finally:
        network.close()


def _address(index: int, end: int) -> str:
    """Return an end of a link, 1 below and 2 above, from the block for tests of networks (RFC 2544)."""
    # 64 blocks of four addresses (/30) in the last byte
    third = index // 64
    block = 4 * (index % 64)
    return f"198.18.{third}.{block + end}"


def free_port() -> int:
    """Return a port of this machine that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port
