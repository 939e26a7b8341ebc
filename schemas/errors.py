"""Errors in messages and keys, and the root of all errors.

PointItError
└── SchemaError
    ├── DecodeError     bytes that are not the message they should be
    └── KeyNameError    a name that cannot stand in a key
"""


class PointItError(Exception):
    """Root of everything PointIt raises on purpose."""


class SchemaError(PointItError, ValueError):
    """Root of everything raised by `pointit.schemas`."""


class DecodeError(SchemaError):
    """Bytes do not decode, or are not valid as the message of their key."""


class KeyNameError(SchemaError):
    """A user, lamp or service name contains characters that a key cannot hold."""
