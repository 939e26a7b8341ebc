"""Bombs of each packing cost bounded memory; whole data are unpacked, damaged ones refused."""

import io
import tracemalloc
import zlib
from collections.abc import Callable

import lz4.frame
import pytest
from zstandard import ZstdCompressor

from pointit.runtime.host.unpacking import (
    TooLargeError,
    UnpackError,
    copy_zstd,
    unpack_lz4,
    unpack_zlib,
    unpack_zstd,
)

LIMIT = 1 << 20
MAX_PEAK = 12 * LIMIT
"""Memory that a decompressor may take beside the limit, bytes: its window and its buffers."""


def copied(data: bytes, max_bytes: int = LIMIT) -> bytes:
    target = io.BytesIO()
    copy_zstd(io.BytesIO(data), target, max_bytes)
    return target.getvalue()


def frame(data: bytes) -> bytes:
    packed: bytes = lz4.frame.compress(data)
    return packed


PACKINGS: list[tuple[Callable[[bytes], bytes], Callable[[bytes, int], bytes]]] = [
    (ZstdCompressor().compress, unpack_zstd),
    (ZstdCompressor().compress, copied),
    (frame, unpack_lz4),
    (zlib.compress, unpack_zlib),
]
packings = pytest.mark.parametrize(("pack", "unpack"), PACKINGS, ids=["zstd", "zstd file", "lz4", "zlib"])


@packings
def test_bomb_is_refused_before_it_is_in_memory(
    pack: Callable[[bytes], bytes], unpack: Callable[[bytes, int], bytes]
) -> None:
    bomb = pack(bytes(64 * LIMIT))
    tracemalloc.start()
    try:
        with pytest.raises(TooLargeError, match="unpacks to more than 1048576 bytes"):
            unpack(bomb, LIMIT)
        _now, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < MAX_PEAK


@packings
def test_data_of_exactly_the_limit_are_unpacked(
    pack: Callable[[bytes], bytes], unpack: Callable[[bytes, int], bytes]
) -> None:
    data = bytes(range(256)) * (LIMIT // 256)
    assert unpack(pack(data), LIMIT) == data
    assert unpack(pack(b""), LIMIT) == b""
    with pytest.raises(TooLargeError):
        unpack(pack(data + b"a"), LIMIT)


@packings
def test_damaged_data_are_refused(
    pack: Callable[[bytes], bytes], unpack: Callable[[bytes, int], bytes]
) -> None:
    packed = pack(bytes(range(256)) * 100)
    with pytest.raises(UnpackError, match="cannot be unpacked"):
        unpack(b"no packing at all", LIMIT)
    with pytest.raises(UnpackError, match="cannot be unpacked"):
        unpack(packed[:10] + bytes(8) + packed[18:], LIMIT)
