"""Counts the messages that cross a link, by kind: run at its lower end.

It says with an empty line that it is ready, counts for as many seconds as the line says that it gets then,
and prints JSON. Each message on Zenoh names its kind in clear, unless the link is encrypted. A name that is
cut by the end of a packet is missed. Linux only, as root.
"""

import json
import re
import socket
import sys
import time
from collections import Counter
from typing import Any

KIND = re.compile(rb"application/msgpack;([A-Z]\w+)\.v\d+")
OUTGOING = 4
"""`PACKET_OUTGOING`, packet(7)."""
ALL = 3
"""`ETH_P_ALL`."""
MAX_PACKET = 65_536
BUFFER = 8 * 1024 * 1024


def count(wire: socket.socket, duration_s: float) -> dict[str, Any]:
    """Return the time and the number of messages of each kind that left and entered by `wire`."""
    up, down = Counter[str](), Counter[str]()
    began_s = time.monotonic()
    while (left_s := began_s + duration_s - time.monotonic()) > 0:
        wire.settimeout(left_s)
        try:
            packet, (_, _, direction, *_) = wire.recvfrom(MAX_PACKET)
        except TimeoutError:
            break
        kinds: list[bytes] = KIND.findall(packet)
        counted = up if direction == OUTGOING else down
        counted.update(kind.decode("ascii") for kind in kinds)
    counts = {kind: [up[kind], down[kind]] for kind in sorted({*up, *down})}
    return {"lasted_s": time.monotonic() - began_s, "counts": counts}


def _main(device: str) -> None:
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW) as wire:  # receives nothing until it is bound
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        sys.stdout.write("\n")
        sys.stdout.flush()
        if line := sys.stdin.readline():
            wire.bind((device, ALL))
            sys.stdout.write(json.dumps(count(wire, float(line))) + "\n")


if __name__ == "__main__":
    _main(sys.argv[1])
