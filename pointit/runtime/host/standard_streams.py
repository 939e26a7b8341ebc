"""Standard streams that the caller has closed, as service managers, cron jobs and Windows' pythonw do."""

import os
import sys

STREAMS = (("stdin", "r"), ("stdout", "w"), ("stderr", "w"))
"""Names of the streams in `sys` and their modes, by the number of their descriptor."""


def open_closed_streams() -> None:
    """Open the null device in place of each standard stream that is closed.

    Python has None for such a stream. The next file or socket would get its number, and what libraries in C
    print would be written there.
    """
    for number, (name, mode) in enumerate(STREAMS):
        if getattr(sys, name) is not None:
            continue
        try:
            os.fstat(number)
        except OSError:
            null = os.open(os.devnull, os.O_RDWR)
            if null != number:
                os.dup2(null, number)
                os.close(null)
        stream = open(os.devnull, mode, encoding="utf-8")  # noqa: SIM115, PTH123 - it lives as long as the process
        setattr(sys, name, stream)
