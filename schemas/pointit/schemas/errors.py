"""Errors in messages and keys.

SchemaError
├── DecodeError     bytes that are not the message they should be
└── KeyNameError    a name that cannot stand in a key
"""


class SchemaError(ValueError):
    """Root of everything raised by `pointit.schemas`."""


class DecodeError(SchemaError):
    """Bytes do not decode, or are not valid as the message of their key."""


class KeyNameError(SchemaError):
    """A user, lamp or service name contains characters that a key cannot hold."""
