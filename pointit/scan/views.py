"""Views of cameras: the image positions of the pixels of named strips and lamps in each photograph."""

import codecs
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pydantic import ConfigDict, TypeAdapter, ValidationError

from pointit.geometry.vector import Vec3
from pointit.maps.model import MAX_PIXELS
from pointit.runtime.config.validation_message import format_value
from pointit.runtime.errors import ConfigError
from pointit.schemas import KeyNameError
from pointit.schemas.text import describe_mistake, system_reason
from pointit.schemas.topics import check_name

MAX_VIEWS = 64
MAX_SIGHTINGS = 20_000
"""Limit of the sightings of one view."""
MAX_IMAGE = 16_384
"""Limit of an image's width and height, pixels."""
MIN_KNOWN_M = 0.01
"""Least known length, m."""
MAX_KNOWN_M = 1000
"""Largest known length, m."""
MAX_FILE = 64 * 2**20
"""Limit of a file of views, bytes."""
STRICT = ConfigDict(extra="forbid")
"""A misspelt field of a file is an error."""


@dataclass(frozen=True)
class StripSpec:
    """A strip as it is sold: `count` pixels, `pitch_m` from pixel to pixel, None if that is unknown."""

    __pydantic_config__: ClassVar = STRICT
    name: str
    count: int
    pitch_m: float | None = None


@dataclass(frozen=True)
class LampSpec:
    """A lamp: a single point of light, such as a smart lamp, or the only pixel of an output.

    Each view that shows it has one sighting of its name with pixel 0: the centroid of its light. Two views
    from a step apart place it. Lamps help to place no view: strips in common do that.
    """

    name: str


@dataclass(frozen=True)
class StripSighting:
    """A pixel in an image.

    Attributes:
        name: name of the strip or lamp.
        pixel: number on the strip's wire, from 0. 0 for a lamp.
        u, v: position of the centre of its light, image pixels, right and down from the top left corner.
    """

    name: str
    pixel: int
    u: float
    v: float


@dataclass(frozen=True)
class CameraView:
    """A photograph taken from one position; a pixel may be seen twice, for example in a mirror.

    Attributes:
        width, height: size of the image, image pixels. All views of a scan are of one camera.
        sightings: in any order.
        gravity: unit vector of "down" in the camera's frame (x right, y down, z forward). None if unknown.
    """

    __pydantic_config__: ClassVar = STRICT
    width: int
    height: int
    sightings: tuple[StripSighting, ...]
    gravity: Vec3 | None = None


@dataclass(frozen=True)
class Mark:
    """A pixel of a strip, or a lamp (pixel 0)."""

    name: str
    pixel: int = 0


@dataclass(frozen=True)
class KnownLength:
    """A measured distance from pixel to pixel, m, and its standard deviation, m."""

    __pydantic_config__: ClassVar = STRICT
    start: Mark
    end: Mark
    metres: float
    sigma_m: float = 0.005


@dataclass(frozen=True)
class Survey:
    """All that a scan is computed from; the JSON that `pointit map scan --from` reads."""

    __pydantic_config__: ClassVar = STRICT
    strips: tuple[StripSpec, ...] = ()
    lamps: tuple[LampSpec, ...] = ()
    views: tuple[CameraView, ...] = ()
    known_length: KnownLength | None = None


def read_survey(path: Path) -> Survey:
    """Return the survey in the JSON file at `path`.

    Raises:
        ConfigError: If it cannot be read, or is invalid. One sentence with file, place, value and remedy.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_FILE + 1).removeprefix(codecs.BOM_UTF8)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({system_reason(error)})") from error
    if len(data) > MAX_FILE:
        raise ConfigError(f"{path}: more than {MAX_FILE} bytes: no file of views")
    try:
        return parse_survey(data)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def parse_survey(data: bytes | str) -> Survey:
    """Return the survey in JSON `data`.

    Raises:
        ConfigError: If it is invalid. One sentence with place, value and remedy.
    """
    try:
        survey = _SURVEY.validate_json(data)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ConfigError(
            f"{where + ': ' if where else ''}{describe_mistake(first)}: no file of views"
        ) from None
    check_survey(survey.strips, survey.lamps, survey.views)
    return survey


def check_survey(
    strips: tuple[StripSpec, ...], lamps: tuple[LampSpec, ...], views: tuple[CameraView, ...]
) -> None:
    """Check names, numbers and limits.

    Raises:
        ConfigError: If a name is given twice or unknown, or a number is outside its limits. One sentence.
    """
    counts = _pixel_counts(strips, lamps)
    if len(counts) < len(strips) + len(lamps):
        raise ConfigError("two strips or lamps have the same name; rename one of them")
    if len(views) > MAX_VIEWS:
        raise ConfigError(f"{len(views)} views; {MAX_VIEWS} at most")
    for name in counts:
        try:
            check_name(name)
        except KeyNameError as error:
            raise ConfigError(str(error)[:200]) from None
    for strip in strips:
        if problem := _strip_problem(strip):
            raise ConfigError(f"strip {strip.name!r}: {problem}")
    for number, view in enumerate(views, 1):
        for problem in _view_problems(view, counts):
            raise ConfigError(f"view {number}: {problem}")


def check_known_length(known: KnownLength, strips: Sequence[StripSpec], lamps: Sequence[LampSpec]) -> None:
    """Check a known length.

    Raises:
        ConfigError: If it is outside its limits, or not between two different pixels. One sentence.
    """
    counts = _pixel_counts(strips, lamps)
    for mark in (known.start, known.end):
        if not 0 <= mark.pixel < counts.get(mark.name, 0):
            raise ConfigError(
                f"the known length is at pixel {mark.pixel} of {mark.name!r}, which is not there"
            )
    if known.start == known.end or not MIN_KNOWN_M <= known.metres <= MAX_KNOWN_M:
        raise ConfigError(
            f"a known length is {MIN_KNOWN_M} to {MAX_KNOWN_M} m, between two different pixels or lamps"
        )
    if not 0 < known.sigma_m <= known.metres:
        raise ConfigError(f"sigma_m of the known length: {known.sigma_m:g}; write above 0, up to its metres")


def _pixel_counts(strips: Sequence[StripSpec], lamps: Sequence[LampSpec]) -> dict[str, int]:
    """Return the number of pixels of each strip and lamp by name."""
    counts = dict.fromkeys((lamp.name for lamp in lamps), 1)
    for strip in strips:
        counts[strip.name] = strip.count
    return counts


def _strip_problem(strip: StripSpec) -> str:
    if not 2 <= strip.count <= MAX_PIXELS:
        return f"{strip.count} pixels; write 2 to {MAX_PIXELS}"
    if strip.pitch_m is not None and not 0.001 <= strip.pitch_m <= 1.0:
        return f"a pitch of {strip.pitch_m:g} m; write 0.001 to 1 m (60 pixels a metre: 0.01667)"
    return ""


def _view_problems(view: CameraView, counts: dict[str, int]) -> Iterator[str]:
    if not (16 <= view.width <= MAX_IMAGE and 16 <= view.height <= MAX_IMAGE):
        yield f"an image of {view.width} x {view.height} pixels; each 16 to {MAX_IMAGE}"
    if len(view.sightings) > MAX_SIGHTINGS:
        yield f"{len(view.sightings)} sightings; {MAX_SIGHTINGS} at most"
    if view.gravity is not None and not abs(math.hypot(*view.gravity) - 1.0) < 0.1:
        yield f"gravity {format_value(list(view.gravity))} is no unit vector"
    for seen in view.sightings:
        if seen.name not in counts:
            yield f"no strip or lamp is called {seen.name!r}; add it to strips or lamps"
        elif not 0 <= seen.pixel < counts[seen.name]:
            yield f"{seen.name!r} has no pixel {seen.pixel}; its pixels are 0 to {counts[seen.name] - 1}"
        if not (abs(seen.u) < 4 * MAX_IMAGE and abs(seen.v) < 4 * MAX_IMAGE):
            yield f"a pixel of {seen.name!r} is at {seen.u}, {seen.v}, outside any image"


_SURVEY = TypeAdapter(Survey)
