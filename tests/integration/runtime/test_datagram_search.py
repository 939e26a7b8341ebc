"""A search by datagrams ends in time and stays small, however much is answered."""

import socket
import time

import pytest

from pointit.runtime import datagram_search
from pointit.runtime.config.plugins import FoundDevice

ANSWER = b"\x01\x02here"


async def test_answers_without_end_neither_prolong_it_nor_fill_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(datagram_search, "MAX_FOUND", 3)
    monkeypatch.setattr(datagram_search, "found_addresses", list[str])
    began_s = time.monotonic()
    ports = list[int]()
    addresses = list[str]()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device:
        device.bind(("127.0.0.1", 0))

        def request(port: int) -> bytes:
            ports.append(port)
            device.sendto(ANSWER, ("127.0.0.1", port))
            return b"who is there?"

        def read(data: bytes, address: str) -> FoundDevice | None:
            assert (data, address) == (ANSWER, "127.0.0.1")
            assert time.monotonic() - began_s < 20.0, "the answers keep the search from ending"
            device.sendto(ANSWER, ("127.0.0.1", ports[0]))  # the next one is there before this one is read
            addresses.append(f"10.0.0.{len(addresses)}")
            return FoundDevice(addresses[-1], "a lamp")

        targets = [device.getsockname()]
        found = await datagram_search.search_by_datagrams("lamps", 0.3, targets, request, read)
    assert [each.address for each in found] == addresses[:3]
    assert len(addresses) > 3
