"""The result of a scan: positions with their uncertainty in a room frame, and as the text of a map file."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3
from pointit.runtime.errors import PointItError
from pointit.scan.bundle import vec3
from pointit.scan.by_pointing import PointedAt, box_of, screen_of

COMPLETE_M = 0.01


class ScanError(PointItError):
    """The views determine no room. The message is one sentence with the cause and the remedy."""


@dataclass(frozen=True)
class Camera:
    """The pose of a view. `rotation` (3 x 3) and `translation_m` (3) move room points into its frame."""

    rotation: Array
    translation_m: Array

    @property
    def position_m(self) -> Vec3:
        """Return the position in the room."""
        return vec3(-self.rotation.T @ self.translation_m)


@dataclass(frozen=True)
class ScannedStrip:
    """A strip in the room.

    Attributes:
        name, count: as given.
        line_m: its line from half a pixel before pixel 0 to half a pixel after the last, with its corners.
        sigma_m: largest standard deviation of an end or corner, in the worst direction, beside the other
            strips (the room's position, heading and scale apart).
        pitch_m: measured distance from pixel to pixel along the line.
        views: number of views that determine it.
        identified: True if ends and corners are determined, and agree with the stated strip.
        reason: what is wrong or to be known, or `""`. One sentence.
        covariance: of the vertices of `line_m`, 3 v x 3 v, m².
    """

    name: str
    count: int
    line_m: tuple[Vec3, ...]
    sigma_m: float
    pitch_m: float
    views: int
    identified: bool
    reason: str = ""
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False, compare=False)

    @property
    def start(self) -> Vec3:
        """Return the end at pixel 0, m."""
        return self.line_m[0]

    @property
    def end(self) -> Vec3:
        """Return the end at the last pixel, m."""
        return self.line_m[-1]


@dataclass(frozen=True)
class ScannedLamp:
    """A lamp in the room; fields as of `ScannedStrip`."""

    name: str
    position_m: Vec3
    sigma_m: float
    views: int
    identified: bool
    reason: str = ""
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False, compare=False)


@dataclass(frozen=True)
class Scan:
    """A scanned room: level, z up, z = 0 at the lowest point until it is placed.

    Attributes:
        cameras: pose of each view, None if it could not be placed.
        focal_px, distortion: lens; distortion is k1 of normalized image coordinates.
        strips, lamps: by name. Those that no view determines are not among them, but in `problems`.
        level_sigma_rad: standard deviation of the level per axis. `level_from`: gravity or strips.
        scale_sigma: relative standard deviation of all lengths. `scale_from`: length or pitch.
        problems: sentences about the scan as a whole, and strips that are not determined.
    """

    cameras: tuple[Camera | None, ...]
    focal_px: float
    distortion: float
    strips: Mapping[str, ScannedStrip]
    lamps: Mapping[str, ScannedLamp]
    level_sigma_rad: float
    level_from: str
    scale_sigma: float
    scale_from: str
    missing: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()

    def complete(self, limit_m: float = COMPLETE_M) -> bool:
        """Return True if all strips and lamps are identified with sigma of at most `limit_m`."""
        if self.missing:
            return False
        return all(light.identified and light.sigma_m <= limit_m for light in self.lights)

    @property
    def lights(self) -> list[ScannedStrip | ScannedLamp]:
        """Return all strips, then all lamps."""
        return [*self.strips.values(), *self.lamps.values()]

    def placed(self, origin_m: Vec3, heading_rad: float) -> "Scan":
        """Return the scan in the room's frame {W}: z stays up.

        Args:
            origin_m: point of this scan's frame that becomes [0, 0, 0].
            heading_rad: direction of this scan's frame, about z from its x, that becomes x.
        """
        cosine = math.cos(heading_rad)
        sine = math.sin(heading_rad)
        turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        shift = -turn @ np.array(origin_m)
        return self.moved(turn, shift)

    def moved(self, turn: Array, shift: Array) -> "Scan":
        """Return the scan with every point X at `turn` (3 x 3 rotation) X + `shift` (3)."""

        def moved_point(point: Vec3) -> Vec3:
            return vec3(turn @ np.array(point) + shift)

        def turned_covariance(covariance: Array) -> Array:
            block = np.kron(np.eye(len(covariance) // 3), turn)
            return np.asarray(block @ covariance @ block.T)

        # A camera sees the same: x = R X + t with the moved X gives R' = R turn^T and t' = t - R' shift.
        cameras: list[Camera | None] = []
        for camera in self.cameras:
            if camera is None:
                cameras.append(None)
                continue
            rotation = camera.rotation @ turn.T
            translation_m = camera.translation_m - rotation @ shift
            cameras.append(Camera(rotation, translation_m))

        strips: dict[str, ScannedStrip] = {}
        for name, strip in self.strips.items():
            line_m = tuple(moved_point(point) for point in strip.line_m)
            covariance = turned_covariance(strip.covariance)
            strips[name] = replace(strip, line_m=line_m, covariance=covariance)
        lamps: dict[str, ScannedLamp] = {}
        for name, lamp in self.lamps.items():
            position_m = moved_point(lamp.position_m)
            covariance = turned_covariance(lamp.covariance)
            lamps[name] = replace(lamp, position_m=position_m, covariance=covariance)
        return replace(self, cameras=tuple(cameras), strips=strips, lamps=lamps)


def map_text(scan: Scan, *, only_identified: bool = True) -> str:
    """Return the text of a map file: each strip and lamp with its sigma and its note."""
    lamps = list(scan.lamps.values())
    strips = list(scan.strips.values())
    if only_identified:
        lamps = [lamp for lamp in lamps if lamp.identified]
        strips = [strip for strip in strips if strip.identified]

    # How good it is, and from what.
    photographs = sum(camera is not None for camera in scan.cameras)
    scale = "the known length" if scan.scale_from == "length" else "the pitch of the strips"
    level = "gravity" if scan.level_from == "gravity" else "the strips, most of which are level or upright"
    scale_percent = 100 * scan.scale_sigma
    level_deg = math.degrees(scan.level_sigma_rad)
    lines = [
        f"# A room scanned from {photographs} photographs.",
        f"# Lengths: within {scale_percent:.1f} %, from {scale}.",
        f"# Level: within {level_deg:.1f} degrees, from {level}.",
    ]

    if lamps:
        lines.append("lamps:")
    for lamp in lamps:
        name = json.dumps(lamp.name)
        position = list(_rounded(lamp.position_m))
        note = _note(lamp.sigma_m, lamp.reason)
        lines.append(f"  {name}: {{position: {position}}}  {note}")
    if strips:
        lines.append("strips:")
    for strip in strips:
        name = json.dumps(strip.name)
        note = _note(strip.sigma_m, strip.reason)
        vertices = [list(_rounded(point)) for point in strip.line_m]
        lines.append(f"  {name}:  {note}")
        lines.append(f"    line: {vertices}")
        lines.append(f"    pixels: {strip.count}")
    return "\n".join([*lines, ""])


def _note(sigma_m: float, reason: str) -> str:
    note = f"# within {1000 * sigma_m:.0f} mm (1 sigma)"
    return f"{note}; {reason}" if reason else note


def _rounded(point: Vec3) -> Vec3:
    x, y, z = (round(value, 3) + 0.0 for value in point)
    return (x, y, z)


def pointed_text(things: Mapping[str, Sequence[PointedAt]], kind: str) -> str:
    """Return the section of a map for things of a kind (lamp, box, screen or table): corners by name.

    Raises:
        RefusedError: If the corners of a box, screen or table span none.
    """
    lines = [{"lamp": "lamps:", "box": "boxes:"}.get(kind, "planes:")]
    for name, pointed_corners in things.items():
        corners = [corner.position_m for corner in pointed_corners]
        if kind == "lamp":
            entry: dict[str, object] = {"position": list(_rounded(corners[0]))}
        elif kind == "box":
            entry = box_of(corners).model_dump(mode="json", exclude_none=True)
        else:
            entry = screen_of(corners).model_dump(mode="json", exclude_none=True)
        fields = [f"{key}: {json.dumps(value)}" for key, value in entry.items()]
        flow = ", ".join(fields)

        # A thing is as good as its worst corner.
        sigma_m = max(corner.sigma_m for corner in pointed_corners)
        reasons = [corner.reason for corner in pointed_corners if corner.reason]
        note = _note(sigma_m, reasons[0] if reasons else "")
        lines.append(f"  {json.dumps(name)}: {{{flow}}}  {note}")
    return "\n".join([*lines, ""])
