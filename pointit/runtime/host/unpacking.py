"""Decompressors under a limit: what data unpack to is bounded before it is in memory.

All of the product's decompressors are here, since a few bytes of any packing can become gigabytes. Libraries
that unpack by themselves get these, or the code that opens them sets a limit of its own.
"""

import zlib
from collections.abc import Callable
from typing import IO, Any

from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy

MAX_BYTES = 32 * 1024 * 1024
"""Maximum size of unpacked data, bytes, unless the caller gives another one."""
MAX_WINDOW_BYTES = 128 * 1024 * 1024
"""Maximum memory of a decompressor of a whole file, bytes, as that of the command `zstd`."""
BLOCK_BYTES = 1 << 20
"""Bytes that are unpacked at once from a file."""


class UnpackError(ValueError):
    """Data are damaged, or unpack to more than the limit."""


class TooLargeError(UnpackError):
    """Data unpack to more than the limit."""

    def __init__(self, max_bytes: int) -> None:
        super().__init__(f"unpacks to more than {max_bytes} bytes")


def unpack_zstd(data: bytes, max_bytes: int = MAX_BYTES) -> bytes:
    """Return `data`, unpacked by Zstandard.

    Raises:
        UnpackError: If they are damaged, or unpack to more than `max_bytes`.
        ConfigError: If the extra is missing.
    """
    zstandard = _zstandard()
    try:
        with zstandard.ZstdDecompressor(max_window_size=MAX_BYTES).stream_reader(data) as reader:
            unpacked: bytes = reader.read(max_bytes + 1)
    except (zstandard.ZstdError, MemoryError) as error:
        raise UnpackError(f"cannot be unpacked ({error})") from error
    return _limited(unpacked, max_bytes)


def unpack_lz4(data: bytes, max_bytes: int = MAX_BYTES) -> bytes:
    """Return `data`, a frame of LZ4, unpacked. Raises as `unpack_zstd`."""
    try:
        from lz4.frame import LZ4FrameDecompressor  # noqa: PLC0415 - of an extra
    except ImportError as error:
        raise ConfigError(f"data packed with lz4 need {remedy('record')}") from error
    decompressor = LZ4FrameDecompressor()
    try:
        unpacked: bytes = decompressor.decompress(data, max_length=max_bytes + 1)
    except (RuntimeError, MemoryError) as error:
        raise UnpackError(f"cannot be unpacked ({error})") from error
    _limited(unpacked, max_bytes)
    if not decompressor.eof:
        raise UnpackError("cannot be unpacked (it is cut off)")
    return unpacked


def unpack_zlib(data: bytes, max_bytes: int = MAX_BYTES) -> bytes:
    """Return `data`, unpacked by zlib. Raises as `unpack_zstd`."""
    decompressor = zlib.decompressobj()
    try:
        unpacked = decompressor.decompress(data, max_bytes + 1)
    except (zlib.error, MemoryError) as error:
        raise UnpackError(f"cannot be unpacked ({error})") from error
    _limited(unpacked, max_bytes)
    if not decompressor.eof:
        raise UnpackError("cannot be unpacked (it is cut off)")
    return unpacked


UNPACKERS: dict[str, Callable[[bytes, int], bytes]] = {"zstd": unpack_zstd, "lz4": unpack_lz4}
"""Decompressors by the names of packings in containers."""


def copy_zstd(packed: IO[bytes], unpacked: IO[bytes], max_bytes: int) -> None:
    """Unpack the file `packed` by Zstandard into `unpacked`, of which the memory holds a block only.

    Raises as `unpack_zstd`. `unpacked` may have got a part by then.
    """
    zstandard = _zstandard()
    decompressor = zstandard.ZstdDecompressor(max_window_size=MAX_WINDOW_BYTES)
    reader = decompressor.stream_reader(packed, read_across_frames=True)
    size = 0
    try:
        while True:
            block = reader.read(BLOCK_BYTES)
            if not block:
                return
            size += len(block)
            if size > max_bytes:
                raise TooLargeError(max_bytes)
            unpacked.write(block)
    except (zstandard.ZstdError, MemoryError) as error:
        raise UnpackError(f"cannot be unpacked ({error})") from error


def _limited(unpacked: bytes, max_bytes: int) -> bytes:
    if len(unpacked) > max_bytes:
        raise TooLargeError(max_bytes)
    return unpacked


def _zstandard() -> Any:
    try:
        import zstandard  # noqa: PLC0415 - of an extra
    except ImportError as error:
        raise ConfigError(f"data packed with zstd need {remedy('record')}") from error
    return zstandard
