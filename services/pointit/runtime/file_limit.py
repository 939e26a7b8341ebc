"""How many files this process may have open; connections are files, too."""

import contextlib
import sys


def raise_file_limit() -> None:
    """Let this process have as many files open as the system lets it at most: mostly it begins with 1024.

    Where the system has no such limit, or does not let it be raised, it stays as it is.
    """
    if sys.platform == "win32":
        return
    import resource  # noqa: PLC0415 - there is none on Windows

    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    with contextlib.suppress(OSError, ValueError):  # macOS: "no limit" is more than it takes
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
