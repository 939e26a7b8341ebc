"""The MCAP library, which the extra `record` installs. No other module of PointIt loads it."""

from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy

try:
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import McapError
    from mcap.opcode import Opcode
    from mcap.records import Channel, Chunk, Metadata, Schema
    from mcap.writer import MCAP0_MAGIC, CompressionType, Writer
    from zstandard import ZstdDecompressor, ZstdError
except ImportError as error:
    raise ConfigError(f"recordings need {remedy('record')}") from error

__all__ = [
    "MCAP0_MAGIC",
    "Channel",
    "Chunk",
    "CompressionType",
    "McapError",
    "Metadata",
    "Opcode",
    "ReadDataStream",
    "Schema",
    "Writer",
    "ZstdDecompressor",
    "ZstdError",
]
