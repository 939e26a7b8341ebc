"""Texts for participants, and their pictures."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import Field, model_validator

from pointit.errors import ConfigError
from pointit.runtime.config.config import Config
from pointit.runtime.config.yaml_file import written_text
from pointit.schemas.text import system_reason

MAX_BYTES = 16 * 1024 * 1024
"""Maximum size of a picture."""
KINDS = {b"\x89PNG\r\n\x1a\n": "image/png", b"\xff\xd8\xff": "image/jpeg", b"GIF8": "image/gif"}
"""Media type by the first bytes of a file."""


class StudyStep(Config):
    """A text, which may have a picture. Written as a mapping, or as the text alone."""

    text: str = ""
    image: str = Field(default="", description="picture in the folder of the file: PNG, JPEG, GIF or WebP")
    alt: str = Field(default="", description="description of the picture, for people who do not see it")

    @model_validator(mode="before")
    @classmethod
    def _of_text(cls, given: Any) -> Any:
        text = written_text(given)
        return {"text": text} if isinstance(text, str) else given


class Picture(NamedTuple):
    """A picture as it is served."""

    content: bytes
    media_type: str


def read_pictures(steps: Iterable[StudyStep], folder: Path) -> dict[str, Picture]:
    """Return the pictures of `steps` by `Step.image`; all are in `folder` or below.

    Raises: ConfigError: If one is missing, elsewhere, too large or no picture.
    """
    return {step.image: _picture(step.image, folder) for step in steps if step.image}


def _picture(name: str, folder: Path) -> Picture:
    path = folder / name
    try:
        if not path.resolve().is_relative_to(folder.resolve()):
            raise ConfigError(f"image {name}: is not beside the study; copy it to {folder}")
        is_small = path.stat().st_size <= MAX_BYTES
        content = path.read_bytes() if path.is_file() and is_small else b""
    except OSError as error:
        raise ConfigError(f"image {name}: {path} cannot be read ({system_reason(error)})") from error
    except (RuntimeError, ValueError) as error:  # links in a circle; a null character
        raise ConfigError(f"image {name!r}: cannot be read ({error})") from error
    kind = _media_type(content)
    if not kind:
        raise ConfigError(f"image {name}: use a PNG, JPEG, GIF or WebP of at most {MAX_BYTES >> 20} MiB")
    return Picture(content, kind)


def _media_type(content: bytes) -> str:
    """Return the media type of a picture by its first bytes, or `""` if it is none."""
    if content[:4] == b"RIFF" and content[8:12] == b"WEBP":
        return "image/webp"
    for first_bytes, media_type in KINDS.items():
        if content.startswith(first_bytes):
            return media_type
    return ""
