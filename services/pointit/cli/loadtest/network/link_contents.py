"""Counts the messages that cross a link, by kind: run at its lower end, for as many seconds as given.

Each message on Zenoh names its kind in clear, unless the link is encrypted. Linux only, as root.
"""

import json
import re
import socket
import sys
import time
from collections import Counter

KIND = re.compile(rb"application/msgpack;([A-Z]\w+)\.v\d+")
OUTGOING = 4
"""`PACKET_OUTGOING`, packet(7)."""
ALL = 3
"""`ETH_P_ALL`."""
MAX_PACKET = 65_536
BUFFER = 8 * 1024 * 1024


def count(device: str, duration_s: float) -> dict[str, list[int]]:
    """Return the number of messages of each kind that left and entered by `device`."""
    up, down = Counter[str](), Counter[str]()
    end_s = time.monotonic() + duration_s
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ALL)) as wire:
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        wire.bind((device, 0))
        while (left_s := end_s - time.monotonic()) > 0:
            wire.settimeout(left_s)
            try:
                packet, (_, _, direction, *_) = wire.recvfrom(MAX_PACKET)
            except TimeoutError:
                break
            kinds: list[bytes] = KIND.findall(packet)
            counted = up if direction == OUTGOING else down
            counted.update(kind.decode("ascii") for kind in kinds)
    return {kind: [up[kind], down[kind]] for kind in sorted({*up, *down})}


if __name__ == "__main__":
    sys.stdout.write(json.dumps(count(sys.argv[1], float(sys.argv[2]))))
