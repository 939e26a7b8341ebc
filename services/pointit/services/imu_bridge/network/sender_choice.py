"""Choice of one of the programs that send to a port."""

from pointit.services.imu_bridge.network.udp_server import Address

REPLACED_S = 10.0
"""Time without a datagram after which another machine takes the place of one that nobody has named, s."""
RESTARTED_S = 3.0
"""Time without a datagram after which another port of its machine takes the place, as of an app that was
restarted, s."""
OTHERS_S = 5.0
"""Time for which another sender is named, s."""
MAX_OTHERS = 8
MAX_RIVALS = 64
ROAMING = 8
"""Number of other ports of its machine, while it is silent, that show a new port for each datagram."""


class SenderChoice:
    """Chooses one of the senders, each an address and a port, and remembers the others."""

    def __init__(self, wanted: str = "", *, excludes_rivals: bool = False) -> None:
        """Use a sender at the IP address `wanted`, or the first if it is `""`.

        `excludes_rivals`: one that was heard side by side with the one in use never replaces it.
        """
        self._wanted = wanted
        self._excludes_rivals = excludes_rivals
        self.used: Address | None = None
        """Sender in use."""
        self._received_s = 0.0
        self._others: dict[Address, float] = {}
        self._ports: set[int] = set()
        """Other ports of its machine that were heard since it was."""
        self._roaming = ""
        """Machine that sends each datagram from another port, or `""`."""
        self._rivals: set[Address] = set()
        """Senders that were heard side by side with the one in use."""

    def name(self, address: Address) -> Address:
        """Return a sender's identity: `address`, or port 0 of a machine that always changes its port."""
        return (address[0], 0) if address[0] == self._roaming else address

    def is_used(self, address: Address) -> bool:
        """Return True if `address` is that of the sender in use."""
        return self.used is not None and self.name(address) == self.name(self.used)

    def may_use(self, address: Address, now_s: float, timeout_s: float = REPLACED_S) -> bool:
        """Return True if datagrams of `address` may be used; else remember it.

        Args:
            address: sender.
            now_s: the time, s.
            timeout_s: time for which the sender in use must have been silent, s. At most `RESTARTED_S` for
                its own machine.
        """
        is_beside = self.used is not None and address[0] == self.used[0]
        timeout_s = min(timeout_s, RESTARTED_S) if is_beside else timeout_s
        is_free = self.used is None or self.is_used(address) or now_s - self._received_s > timeout_s
        if is_free and self._wanted in ("", address[0]) and (self._wanted or not self._is_rival(address)):
            return True
        if is_beside:
            self._ports.add(address[1])
            if len(self._ports) == ROAMING:
                self._roaming, self._others = address[0], {}
                return True
        if address in self._others or len(self._others) < MAX_OTHERS:
            self._others[address] = now_s
        return False

    def use(self, address: Address, now_s: float) -> None:
        """Use `address`, which has sent something readable."""
        if self._excludes_rivals and address == self.used and len(self._rivals) < MAX_RIVALS:
            self._rivals |= {each if each[0] == address[0] else (each[0], 0) for each in self._others}
        self.used, self._received_s = address, now_s
        self._ports.clear()
        self._others.pop(address, None)

    def _is_rival(self, address: Address) -> bool:
        return address in self._rivals or (address[0], 0) in self._rivals

    def others(self, now_s: float) -> list[str]:
        """Return the other senders of the last seconds: their address, with the port if it is that in use."""
        self._others = {each: s for each, s in self._others.items() if now_s - s < OTHERS_S}
        return sorted({self.label(each) for each in self._others})

    def label(self, address: Address) -> str:
        """Return the IP address of a sender, with its port if another at this address is in use."""
        host, port = address
        is_beside = self.used is not None and host == self.used[0] and not self.is_used(address)
        return f"{host}:{port}" if is_beside else host
