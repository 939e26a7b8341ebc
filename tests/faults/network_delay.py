"""A link that delays packets: two tun devices, and each packet passes after a random time of its own.

Started as `network_delay.py NEAR FAR LEAST_S MOST_S`; says `ready` when the devices are there, and goes on
until it is killed. Later packets may overtake earlier ones, as they do with `tc netem`.
"""

import fcntl
import heapq
import os
import random
import select
import struct
import sys
import time

TUNSETIFF = 0x400454CA
IFF_TUN_NO_PI = 0x0001 | 0x1000
LONGEST = 65536


def device(name: str) -> int:
    file = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(file, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TUN_NO_PI))
    return file


def main() -> None:
    near, far = device(sys.argv[1]), device(sys.argv[2])
    least_s, most_s = float(sys.argv[3]), float(sys.argv[4])
    print("ready", flush=True)  # noqa: T201 - for the parent process
    other = {near: far, far: near}
    held: list[tuple[float, int, int, bytes]] = []
    count = 0
    while True:
        wait_s = max(0.0, held[0][0] - time.monotonic()) if held else None
        for file in select.select(list(other), (), (), wait_s)[0]:
            packet = os.read(file, LONGEST)
            count += 1
            due_s = time.monotonic() + random.uniform(least_s, most_s)
            heapq.heappush(held, (due_s, count, other[file], packet))
        while held and held[0][0] <= time.monotonic():
            _, _, file, packet = heapq.heappop(held)
            try:
                os.write(file, packet)
            except OSError:  # the device is down: a lost packet
                continue


if __name__ == "__main__":
    main()
