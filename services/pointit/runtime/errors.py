"""Errors at run time.

PointItError                 its text is one sentence for a person: problem, place, action
├── ConfigError              a file, variable or option is wrong; commands exit with 2
├── BusError
│   ├── BusClosedError       used after `close`
│   ├── ListenError          the address to listen on is in use
│   └── ConnectError         nothing answers at the address to connect to
└── RequestError
    ├── NoAnswerError        there is no server of the request, or it did not answer in time
    └── RefusedError         the server refuses with a reason; servers raise it themselves
"""


class PointItError(Exception):
    """Root of everything PointIt raises on purpose."""


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


class RequestError(PointItError):
    """A request got no reply."""


class NoAnswerError(RequestError):
    """Nobody serves the request, or the reply did not come in time."""


class RefusedError(RequestError):
    """The server refuses and gives the reason. Raised by servers, and again at the caller."""
