"""Writes new maps: a file that exists is never replaced."""

from pathlib import Path

from pointit.runtime.errors import ConfigError


def write_new(path: Path, text: str | bytes) -> None:
    """Write `text` to a new file.

    Raises:
        ConfigError: If it exists already, or cannot be written.
    """
    try:
        with path.open("xb") as opened:
            opened.write(text.encode() if isinstance(text, str) else text)
    except FileExistsError as error:
        raise ConfigError(f"{path}: exists already; choose another name or move it away") from error
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror or error})") from error
