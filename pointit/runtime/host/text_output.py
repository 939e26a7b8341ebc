"""Text on standard output, in whatever encoding the terminal or pipe has."""

import io
import os
import sys
from typing import cast


def assume_dumb_terminal() -> None:
    """Set TERM for this process and its children if nothing says which terminal it is.

    Escape sequences would be shown as text there, as in a serial console. On Windows no terminal sets TERM.
    """
    if os.name == "posix" and not os.environ.get("TERM"):
        os.environ["TERM"] = "dumb"


def escape_unencodable() -> None:
    """Configure standard output to escape characters that its encoding lacks, as standard error does."""
    output: object = sys.stdout  # a test, or a program without a console, has another or none
    if isinstance(output, io.TextIOWrapper):
        cast("io.TextIOWrapper", output).reconfigure(errors="backslashreplace")
