"""Errors of the public API. Each is a `PointItError` whose text is one sentence: what, where, what to do."""

from pointit.runtime.errors import (
    AccessDeniedError,
    BusClosedError,
    BusError,
    ConfigError,
    ConnectError,
    ListenError,
    NoAnswerError,
    NoMessageError,
    PointItError,
    RefusedError,
    RequestError,
    VersionError,
    WrongSiteError,
)
from pointit.schemas.base import DecodeError, KeyNameError, SchemaError

__all__ = [
    "AccessDeniedError", "BusClosedError", "BusError", "ConfigError", "ConnectError", "DecodeError",
    "KeyNameError", "ListenError", "NoAnswerError", "NoMessageError", "PointItError", "RefusedError",
    "RequestError", "SchemaError", "VersionError", "WrongSiteError",
]  # fmt: skip
