"""Text on standard output, in whatever encoding the terminal or pipe has."""

import io
import sys
from typing import cast


def escape_unencodable() -> None:
    """Configure standard output to escape characters that its encoding lacks, as standard error does."""
    output: object = sys.stdout  # a test, or a program without a console, has another or none
    if isinstance(output, io.TextIOWrapper):
        cast("io.TextIOWrapper", output).reconfigure(errors="backslashreplace")
