"""What can go wrong while running.

PointItError                 its text is one sentence for a person: what, where, what to do
├── ConfigError              a file, variable or option is wrong; commands exit with 2
├── BusError
│   ├── BusClosedError       used after `close`
│   ├── ListenError          the address to listen on is taken
│   └── ConnectError         nobody answers at the address to connect to
└── RequestError
    ├── NoAnswerError        nobody serves the request, or not in time
    └── RefusedError         the server says why not; servers raise it themselves
"""


class PointItError(Exception):
    """Root of everything PointIt raises on purpose."""


class ConfigError(PointItError):
    """A configuration, map, scenario or recording cannot be used; names file, field and value."""


class BusError(PointItError):
    """The bus cannot do what was asked."""


class BusClosedError(BusError):
    """The bus was used after it was closed."""


class ListenError(BusError):
    """The address to listen on is taken or not ours."""


class ConnectError(BusError):
    """Nobody answers at the address to connect to."""


class RequestError(PointItError):
    """A request got no reply."""


class NoAnswerError(RequestError):
    """Nobody serves the request, or the reply did not come in time."""


class RefusedError(RequestError):
    """The server refuses and says why; raised by servers, and again at the caller."""
