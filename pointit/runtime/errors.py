"""Errors at run time.

PointItError                 its text is one sentence for a person: problem, place, action
├── SchemaError              a message or a name is wrong, see `pointit.schemas.base`
├── ConfigError              a file, variable or option is wrong; commands exit with 2
├── BusError
│   ├── BusClosedError       used after `close`
│   ├── ListenError          the address to listen on is in use
│   ├── ConnectError         nothing answers at the address to connect to
│   │   ├── WrongSiteError   another site answers there
│   │   └── RejectedError    its router rejects the credentials, or wants some
│   ├── NoMessageError       nothing has come on a key
│   └── VersionError         messages are of a version that cannot be read here
└── RequestError
    ├── NoAnswerError        there is no server of the request, or it did not answer in time
    │   └── AccessDeniedError    the rules of a secured site do not permit it
    └── RefusedError         the server refuses with a reason; servers raise it themselves
"""

import typing

from pointit.schemas.base import PointItError as PointItError  # noqa: PLC0414 - the root, defined lowest

EXIT_USAGE = 2
"""Exit code of a command after a `ConfigError`: an argument, a file or a variable is wrong."""


class ConfigError(PointItError):
    """A configuration, map, scenario or recording cannot be used; names file, field and value."""


class BusError(PointItError):
    """The bus cannot do what was requested."""


class BusClosedError(BusError):
    """The bus was used after it was closed."""


class ListenError(BusError):
    """The address to listen on is in use or not of this machine."""


class ConnectError(BusError):
    """Nobody answers at the address to connect to."""


class WrongSiteError(ConnectError):
    """At the address there are other sites, but not the one to join."""


class RejectedError(ConnectError):
    """The router rejects the credentials, or requires some."""


class NoMessageError(BusError, KeyError):
    """Nothing has come on a key so far, or not in time."""

    __str__ = Exception.__str__  # a `KeyError` shows the representation of its sentence


class VersionError(BusError):
    """Messages arrive, but of a version that cannot be read here."""


class RequestError(PointItError):
    """A request got no reply."""


class NoAnswerError(RequestError):
    """Nobody serves the request, or the reply did not come in time."""


class AccessDeniedError(NoAnswerError):
    """This identity may not read, write or request that on a secured site. No other one sees the attempt."""


class RefusedError(RequestError):
    """The server refuses and gives the reason. Raised by servers, and again at the caller."""


def describe(error: BaseException) -> str:
    """Return the class and the message of `error`, in one line."""
    text = f"{type(error).__name__}: {error}"
    first_line = text.partition("\n")[0]
    return first_line[:200].rstrip(": ")


def first_cause(error: BaseException) -> BaseException:
    """Return the error to show to a person of those that `error` groups: a `PointItError` if there is one."""
    if isinstance(error, BaseExceptionGroup):
        group = typing.cast("BaseExceptionGroup[BaseException]", error)
        error = group.subgroup(PointItError) or group
    while isinstance(error, BaseExceptionGroup):
        error = typing.cast("BaseExceptionGroup[BaseException]", error).exceptions[0]
    return error
