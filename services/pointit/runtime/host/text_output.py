"""Text on standard output, in whatever encoding the terminal or pipe has."""

import io
import sys


def escape_unencodable() -> None:
    """Make standard output escape letters that its encoding lacks, as standard error does."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
