"""Perception of the light on the strips: the position of the own cursor, and the state of a thing.

A thing is a segment in its kind's colour, dim while it is free, bright once selected. Its two ends show whose
cursor is on it, or who selected it. A cursor is a short run in its person's colour on top, and overlapping
cursors alternate by pixel. Only the frame's bytes, the map, the things and the own colour are used. A frame
is decoded on a look, not on arrival.
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.vector import Vec3
from pointit.schemas import Environment, StripsFrame, UserProfile
from pointit.schemas.base import Rgb
from pointit.services.user_sim.sight.observed_appearance import (
    DARKEST,
    ObservedAppearance,
    OwnColor,
    UsualLooks,
)
from pointit.services.user_sim.sight.pixels import Key, Kind, SeenPixels, ShownLine

LEVEL_SHARE = 0.8
"""Minimum brightness of a cursor, as a share of its recent brightness."""
ADAPTING = 0.96
"""Factor on the expected brightness after each look without a cursor: the eyes adapt to dimmed strips."""
TOO_WIDE = 1.6
"""Maximum length of a run, in cursors, plus two pixels."""
INTERLEAVED = 4.5
"""Maximum distance of two own pixels, in pixels, where as many cursors overlap as have distinct colours."""
SCALE_M = 0.7
"""Distance from the felt direction that adds as much doubt as a third of the cursor's width, m."""
MAX_DISTANCE_COST = 2.0
"""Limit of the doubt by distance for a light that may not be a margin."""
MAX_COST = 2.6
"""Maximum doubt at which a run still counts as a cursor."""
END_M = 0.06
"""Distance beyond the end of a thing at which a run may be its margin, m. Twice that within, as margins are
longer in a curve and where a cursor touches them."""
NARROW = 0.8
"""Share of the cursor's width below which a run is more likely a margin than a cursor."""
MARK_SHARE = (0.3, 0.7)
"""Range of the brightness of the mark of a ray that passes everything, as a share of the cursor's."""
BLINK_LOOKS = 8
"""Number of consecutive looks after which a dim pixel does not blink, but is a narrow cursor."""
MIXED_PATTERNS = ("striped", "tailed")
"""Patterns with the owner's colour in the body."""
Span = tuple[Key, float, float]
"""A line, and the interval of a thing on it, m."""


class SeenCursor(NamedTuple):
    """The person's own cursor."""

    kind: Kind
    line_id: str
    position_m: float
    """Arc length on the strip, or on the belt beside it."""
    point_m: Vec3
    width_m: float


class _Run(NamedTuple):
    line: ShownLine
    first_m: float
    last_m: float
    pixels: list[int]
    parts: int

    @property
    def width_m(self) -> float:
        return self.last_m - self.first_m + self.line.pitch_m

    @property
    def middle_m(self) -> float:
        return (self.first_m + self.last_m) / 2.0


class Eyes:
    """Perception of frames of one room by one person."""

    def __init__(self) -> None:
        self._pixels = SeenPixels(Environment(stamp_ns=0, name="nothing"))
        self._lights: dict[Key, list[tuple[float, float]]] = {}
        """Parts of strips that are lights of things, as arc lengths from and to, m."""
        self._frame: StripsFrame | None = None
        self._codes: list[int] | None = None
        self._array: NDArray[np.int32] = np.empty(0, dtype=np.int32)
        """The pixels of `_codes`, as an array."""
        self._brightness = 1.0
        """Brightness of recently seen cursors, a share of full brightness."""
        self._full = 1.0
        """Brightness of the last cursor, a share of full brightness."""
        self._dim_looks = 0
        self._usual_looks = UsualLooks()
        self.set_profile(UserProfile(stamp_ns=0))

    def learn(self, room: Environment) -> None:
        """Set the map."""
        self._pixels = SeenPixels(room)
        self._lights = {}
        for thing in room.things:
            self._lights.setdefault(("strip", thing.strip), []).append(thing.part_m)
        self._codes = None

    def set_profile(self, profile: UserProfile) -> None:
        """Set the own colour, or colours, and the width of the own cursor."""
        self._own = OwnColor(profile)
        self._width_m = profile.cursor_width_m
        self._is_mixed = profile.pattern in MIXED_PATTERNS

    def open(self, frame: StripsFrame) -> None:
        """Set the current frame, without decoding it."""
        self._frame = frame
        self._codes = None

    def is_own(self, color: Rgb) -> bool:
        """Return True if `color` is the own one at any brightness."""
        red, green, blue = color
        return self._own.share(red << 16 | green << 8 | blue) > 0.0

    def line(self, key: Key) -> ShownLine | None:
        """Return the pixels of the strip or belt `key`, or None."""
        return self._pixels.lines.get(key)

    def cursor(
        self, kind: Kind, expected_m: Vec3 | None = None, things: Iterable[Span] = ()
    ) -> SeenCursor | None:
        """Return the own cursor, or None if no run is likely.

        Args:
            kind: belt: pixels beside a belt show the belt. strip: they show the strip.
            expected_m: felt point of the hand, {W}.
            things: intervals of things, as their margins may have the same colour.
        """
        # the margin of a thing's light is not where the ray is, as the thing is beside it
        runs = [run for run in self._runs(kind) if self._where(run, kind, self._lights) != "end"]
        best: tuple[float, _Run, Vec3] | None = None
        lying: dict[Key, list[tuple[float, float]]] = {}
        for key, start_m, end_m in things if runs else ():
            lying.setdefault(key, []).append((start_m, end_m))
        marks = [run for run in runs if self._is_mark(run)]
        self._dim_looks = self._dim_looks + 1 if marks else 0
        for run in runs:
            if run in marks and self._dim_looks <= BLINK_LOOKS:
                continue
            cost = abs(math.log(run.width_m / self._width_m)) * 1.5 + 0.3 * (run.parts > 1)
            if cost > 0.0 and _is_cut(run):
                cost /= 2.0
            point_m = run.line.line.point_at(run.middle_m)
            where = self._where(run, kind, lying)
            if expected_m is not None:
                far = math.dist(point_m, expected_m) / SCALE_M
                cost += far if where == "end" else min(far, MAX_DISTANCE_COST)
            if where == "end":
                cost += 1.0 if run.width_m < NARROW * self._width_m else 0.5
            elif where and self._is_mixed:
                cost += 0.7
            if best is None or cost < best[0]:
                best = (cost, run, point_m)
        if best is None or best[0] > MAX_COST:
            self._brightness = max(DARKEST, self._brightness * ADAPTING)
            return None
        _, run, point_m = best
        self._full = self._share(run)
        return SeenCursor(run.line.kind, run.line.id, run.middle_m, point_m, run.width_m)

    def mark(self, kind: Kind) -> Vec3 | None:
        """Return the position of the mark of a ray that passes everything, or None."""
        for run in self._runs_of(self._own_codes(MARK_SHARE[0] * self._full), kind):
            if self._is_mark(run):
                return run.line.line.point_at(run.middle_m)
        return None

    def _is_mark(self, run: _Run) -> bool:
        return run.width_m < 1.5 * run.line.pitch_m and self._share(run) < MARK_SHARE[1] * self._full

    def _share(self, run: _Run) -> float:
        codes = self._decoded()
        return max(self._own.share(codes[pixel]) for pixel in run.pixels)

    def _where(
        self, run: _Run, kind: Kind, lying: Mapping[Key, Sequence[tuple[float, float]]]
    ) -> Literal["", "end", "body"]:
        """Return the part of a thing on which a run is, on any belt."""
        found: Literal["", "body"] = ""
        for line, at_m in self._pixels.places(run.pixels[len(run.pixels) // 2], kind):
            for start_m, end_m in lying.get((line.kind, line.id), ()):
                from_start_m, to_end_m = at_m - start_m, end_m - at_m
                if min(from_start_m, to_end_m) < -END_M:
                    continue
                if min(from_start_m, to_end_m) < 2.0 * END_M:
                    return "end"
                found = "body"
        return found

    def looks(self, kind: str, key: Key, position_m: float, length_m: float) -> ObservedAppearance | None:
        """Return the appearance of a thing of `kind` whose middle is at `position_m` of line `key`.

        None if the strips do not show enough of it.
        """
        line = self._pixels.lines.get(key)
        if line is None:
            return None
        codes = self._decoded()
        first = bisect_left(line.arcs_m, position_m - length_m / 2.0)
        last = bisect_right(line.arcs_m, position_m + length_m / 2.0)
        shown = [codes[line.at[k]] for k in range(first, last)]
        while shown and not shown[-1]:
            shown.pop()
        while shown and not shown[0]:
            shown.pop(0)
        if len(shown) < 3:
            return None
        return self._usual_looks.judge(kind, shown, self._own, self._brightness)

    def _runs(self, kind: Kind) -> list[_Run]:
        """Return runs of pixels that may be the own cursor. Interleaved ones are merged."""
        own = self._own_codes(LEVEL_SHARE * self._brightness)
        if own:
            self._brightness += 0.3 * (max(own.values()) - self._brightness)
        return self._runs_of(own, kind)

    def _own_codes(self, minimum: float) -> dict[int, float]:
        """Return the visible colours that may be the own, with their brightness."""
        codes = set(self._decoded())
        return {code: share for code in codes if code and (share := self._own.share(code)) >= minimum}

    def _runs_of(self, own: Iterable[int], kind: Kind) -> list[_Run]:
        hits: dict[int, tuple[ShownLine, list[tuple[float, int]]]] = {}
        for code in own:
            for pixel in np.flatnonzero(self._array == code).tolist():
                for line, arc_m in self._pixels.places(pixel, kind):
                    hits.setdefault(id(line), (line, []))[1].append((arc_m, pixel))
        longest_m = TOO_WIDE * self._width_m
        runs: list[_Run] = []
        for line, lit in hits.values():
            lit.sort()
            single = _grouped(line, lit, 1.5)
            merged = [run._replace(parts=2) for run in _grouped(line, lit, INTERLEAVED) if run not in single]
            max_m = longest_m + 2.0 * line.pitch_m
            runs += [run for run in (*single, *merged) if run.width_m <= max_m]
        return runs

    def _decoded(self) -> list[int]:
        """Return the colour of every pixel as red * 65536 + green * 256 + blue. Missing ones are dark."""
        if self._codes is not None:
            return self._codes
        shown = {} if self._frame is None else {strip.id: strip.rgb for strip in self._frame.strips}
        parts: list[bytes] = []
        for name, count in self._pixels.strips:
            rgb = shown.get(name, b"")
            parts.append(rgb if len(rgb) == 3 * count else bytes(3 * count))
        pixels = np.frombuffer(b"".join(parts), dtype=np.uint8).reshape(-1, 3).astype(np.int32)
        self._array = pixels[:, 0] * 65536 + pixels[:, 1] * 256 + pixels[:, 2]
        codes: list[int] = self._array.tolist()
        self._codes = codes
        return codes


def _grouped(line: ShownLine, lit: Sequence[tuple[float, int]], gap: float) -> list[_Run]:
    """Return runs of `lit` (arc length and pixel) with at most `gap` pixels from one to the next."""
    runs: list[_Run] = []
    pixels: list[int] = []
    first_m = last_m = lit[0][0]
    for arc_m, pixel in lit:
        if arc_m - last_m > gap * line.pitch_m:
            runs.append(_Run(line, first_m, last_m, pixels, 1))
            first_m, pixels = arc_m, []
        last_m = arc_m
        pixels.append(pixel)
    return [*runs, _Run(line, first_m, last_m, pixels, 1)]


def _is_cut(run: _Run) -> bool:
    """Return True if a run touches the first or last pixel of its line, so that it may be longer."""
    return run.first_m <= run.line.arcs_m[0] or run.last_m >= run.line.arcs_m[-1]
