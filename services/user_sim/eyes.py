"""Perception of the light on the strips: pixels, the own cursor, and the appearance of things.

A thing is a segment in its kind's colour, dim while it is free, bright once selected. Its two ends show whose
cursor is on it, or who selected it. A cursor is a short run in its person's colour on top, and overlapping
cursors alternate by pixel. Only the frame's bytes, the map, the things and the own colour are used. A frame
is decoded on a look, not on arrival.
"""

import contextlib
import functools
import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.array_types import Array
from pointit.geometry.colormap import UnknownColormapError, colormap
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import Belt, Environment, Strip, StripsFrame, UserProfile
from pointit.schemas.base import Rgb
from pointit.schemas.environment import BESIDE_BELT_M

Kind = Literal["strip", "belt"]
Key = tuple[Kind, str]
T = TypeVar("T", Strip, Belt)
Color = tuple[int, int, int]
Interval = tuple[float, float]
"""Arc lengths from and to, m."""
Span = tuple[Key, float, float]
"""A line, and the interval of a thing on it, m."""

MAX_PIXELS = 64 * 4096
"""Limit of the pixels of all strips, that of a frame."""
MAX_PAIRS = 20_000_000
"""Limit of pixels times segments of belts that are compared, beyond that of any hall."""

HUE_TOLERANCE = 0.09
"""Maximum distance of a colour from another one of any brightness, as a share, to count as equal."""

DARKEST = 0.04
"""Minimum brightness of a cursor, as a share of its full colour."""

TINTS = 32
"""Number of distinct colours of a colormap."""
FULL = 1.5
"""Minimum brightness of a selected thing relative to others, which is at least 2 as drawn."""

GAP = 0.6
"""Maximum relative brightness of a pixel of the pattern of a selected thing."""

BRIGHTER = 1.2
"""Minimum brightness of an own mark relative to a thing of the same colour. Selected ones are 1.27 darker."""

UNKNOWN_DIM = 105.0
"""Brightness of unselected things of a kind that was never seen unmarked."""

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


@dataclass(frozen=True, slots=True)
class ShownLine:
    """A strip or a belt, and the pixels that show it, by arc length."""

    kind: Kind
    id: str
    line: Polyline
    pitch_m: float
    """Distance from one pixel to the next on the strip, or strips."""
    arcs_m: list[float] = field(default_factory=list[float])
    """Arc lengths, increasing."""
    at: list[int] = field(default_factory=list[int])
    """Index of each in the frame."""


Place = tuple[ShownLine, float]
"""A line and an arc length on it."""


class SeenPixels:
    """All pixels of a room, numbered in the order of a frame (strips in the map's order)."""

    def __init__(self, room: Environment) -> None:
        """Arrange the strips of `room`. Strips that cannot be drawn, or exceed the limit, are not visible."""
        self.strips: list[tuple[str, int]] = []
        """Ids and numbers of pixels, in the map's order."""
        self.lines: dict[Key, ShownLine] = {}
        self.count = 0

        # Strips one behind the other, as in a frame
        places: list[Array] = []
        pitches: list[Array] = []
        for strip, line in drawable(room.strips):
            if self.count + strip.pixels > MAX_PIXELS:
                break
            places.append(self._add_strip(strip, line))
            pitches.append(np.full(strip.pixels, line.length_m / strip.pixels))
        points = np.concatenate(places) if places else np.empty((0, 3))
        self._pitches_m: Array = np.concatenate(pitches) if pitches else np.empty(0)

        # Belts, as far as their search of pixels is short
        budget = MAX_PAIRS
        for belt, line in drawable(room.belts):
            budget -= len(points) * len(line.tangents)
            if budget >= 0 and len(points):
                self._add_belt(belt, line, points)
        strips = [line for line in self.lines.values() if line.kind == "strip"]
        belts = [line for line in self.lines.values() if line.kind == "belt"]
        self._by_strip = _by_pixel(self.count, strips)

        # A pixel beside no belt shows its strip
        by_belt = _by_pixel(self.count, belts)
        self._by_belt = [belt or strip for belt, strip in zip(by_belt, self._by_strip, strict=True)]

    def places(self, pixel: int, kind: Kind) -> Sequence[Place]:
        """Return the places that `pixel` shows, on belts or on strips only."""
        return (self._by_belt if kind == "belt" else self._by_strip)[pixel]

    def _add_strip(self, strip: Strip, line: Polyline) -> Array:
        offset = self.count
        self.count = self.count + strip.pixels
        self.strips.append((strip.id, strip.pixels))
        pitch_m = line.length_m / strip.pixels
        arcs = (np.arange(strip.pixels, dtype=np.float64) + 0.5) * pitch_m
        pixels = list(range(offset, self.count))
        if strip.direction != 1:
            pixels.reverse()
        arcs_m: list[float] = arcs.tolist()
        self.lines["strip", strip.id] = ShownLine("strip", strip.id, line, pitch_m, arcs_m, pixels)
        points = line.points_at(arcs)
        return points if strip.direction == 1 else points[::-1]

    def _add_belt(self, belt: Belt, line: Polyline, points: Array) -> None:
        """Find the pixels beside a belt, each with the nearest arc length of its centre line."""
        reach_m = belt.width_m / 2.0 + BESIDE_BELT_M
        low = line.vertices_m.min(axis=0) - reach_m
        high = line.vertices_m.max(axis=0) + reach_m

        # Pixels in the box around the belt are few, so that only they are compared with its segments
        is_in_box = np.all((points >= low) & (points <= high), axis=1)
        candidates = np.flatnonzero(is_in_box)
        arcs, gaps = line.nearest_to(points[candidates])
        is_beside = (gaps <= reach_m) & ~line.is_beyond_ends(points[candidates], arcs)
        beside = np.flatnonzero(is_beside)
        order = beside[np.argsort(arcs[beside], kind="stable")]
        if not len(order):
            return
        pixels = candidates[order].tolist()
        pitch_m = float(self._pitches_m[pixels].max())
        arcs_m: list[float] = arcs[order].tolist()
        self.lines["belt", belt.id] = ShownLine("belt", belt.id, line, pitch_m, arcs_m, pixels)


def drawable(things: Sequence[T]) -> Iterator[tuple[T, Polyline]]:
    """Yield `things` with their lines, except those without length, such as a single point."""
    for thing in things:
        with contextlib.suppress(ValueError):
            yield thing, Polyline(thing.line_m)


def _by_pixel(count: int, lines: Sequence[ShownLine]) -> list[list[Place]]:
    places: list[list[Place]] = [[] for _ in range(count)]
    for line in lines:
        for arc_m, pixel in zip(line.arcs_m, line.at, strict=True):
            places[pixel].append((line, arc_m))
    return places


class OwnColor:
    """The person's own colour, or colours."""

    def __init__(self, profile: UserProfile) -> None:
        self._own = np.array([profile.cursor_color], dtype=np.float64)
        if profile.cursor_colormap:
            with contextlib.suppress(UnknownColormapError):  # it is drawn in `cursor_color`
                tints = colormap(profile.cursor_colormap)(np.linspace(0.0, 1.0, TINTS))
                self._own = tints.astype(np.float64)
        self._shares: dict[int, float] = {0: 0.0}
        """By colour: brightness of an own cursor of this colour, 0 if it is none."""

    def share(self, code: int) -> float:
        """Return the brightness of an own cursor that looks like this, as a share, or 0 if it is none."""
        share = self._shares.get(code)
        if share is None:
            if len(self._shares) > 4096:
                self._shares = {0: 0.0}
            share = self._shares[code] = self._share_of(rgb(code))
        return share

    def _share_of(self, color: Color) -> float:
        pixel = np.array(color, dtype=np.float64)
        squares = np.maximum(np.einsum("ij,ij->i", self._own, self._own), 1.0)
        shares = self._own @ pixel / squares
        offsets = pixel - shares[:, None] * self._own
        distances = np.linalg.norm(offsets, axis=1)
        deviations = distances / np.maximum(shares * np.sqrt(squares), 1e-9)
        best = int(np.argmin(deviations))
        is_own = deviations[best] <= HUE_TOLERANCE and shares[best] >= DARKEST
        return float(shares[best]) if is_own else 0.0


def rgb(code: int) -> Color:
    """Return red, green and blue of a pixel's code."""
    return (code >> 16, code >> 8 & 255, code & 255)


def brightness(code: int) -> int:
    """Return the maximum of red, green and blue, 0 to 255."""
    return max(rgb(code))


@functools.lru_cache(maxsize=4096)
def is_same_hue(code: int, other: int) -> bool:
    """Return True if two colours differ in brightness only."""
    red, green, blue = rgb(code)
    other_red, other_green, other_blue = rgb(other)
    dot = red * other_red + green * other_green + blue * other_blue
    lengths = math.hypot(red, green, blue) * math.hypot(other_red, other_green, other_blue)
    return lengths > 0.0 and dot >= lengths * math.cos(HUE_TOLERANCE)


class ObservedAppearance(NamedTuple):
    """Appearance of a thing."""

    marked: bool
    """True if its ends are in another colour than its middle."""
    full: bool
    """True if it is as bright as selected things."""
    hidden: bool
    """True if a cursor covers its middle, so that its brightness is uncertain."""
    own: bool
    """True if an end is in the own colour."""
    foreign: bool
    """True if an end is in a colour that is neither the own nor the thing's."""


class UsualLooks:
    """Learned appearance of unselected things of each kind."""

    def __init__(self) -> None:
        self._dim: dict[str, tuple[int, int]] = {}
        """By kind: colour and brightness of unselected things."""

    def judge(
        self, kind: str, shown: Sequence[int], own_color: OwnColor, cursor_brightness: float
    ) -> ObservedAppearance:
        """Return the appearance of a thing, and learn from unmarked ones.

        Args:
            kind: kind of the thing.
            shown: codes of its pixels from end to end, at least 3.
            own_color: colour of the person.
            cursor_brightness: recent brightness of cursors, as a share.
        """
        # Pixels in the colour of the thing itself
        learned = self._dim.get(kind)
        body = learned[0] if learned is not None else _commonest(shown[1:-1])
        is_plain = [is_same_hue(code, body) for code in shown]
        plain_positions = [position for position, plain in enumerate(is_plain) if plain]
        plain_codes = [shown[position] for position in plain_positions]

        # Without marks at its ends it is unselected, which shows what such things look like
        is_own_hue = own_color.share(body) > 0.0  # then only brightness tells the own marks from the thing
        has_plain_ends = is_plain[0] and is_plain[-1]
        if has_plain_ends and (not is_own_hue or len(set(shown)) == 1):
            usual = _commonest(plain_codes)
            self._dim[kind] = (usual, brightness(usual))
            return ObservedAppearance(marked=False, full=False, hidden=False, own=False, foreign=False)

        # Owners of the marks
        dimmest = min(map(brightness, plain_codes), default=0)
        marks: list[int] = []
        for code in (shown[0], shown[-1]):
            is_bright = is_own_hue and brightness(code) > BRIGHTER * dimmest
            if is_bright or not is_same_hue(code, body):
                marks.append(code)
        is_own = [own_color.share(code) > 0.0 for code in marks]
        own = any(is_own)
        foreign = not all(is_own)
        if not plain_codes:  # covered by a cursor or another thing
            return ObservedAppearance(marked=True, full=False, hidden=True, own=own, foreign=foreign)

        # Brightness of the thing, as near to its middle as it is not covered
        dim = learned[1] if learned is not None else UNKNOWN_DIM * cursor_brightness
        middle = (len(shown) - 1) / 2.0
        nearest = min(plain_positions, key=lambda position: abs(position - middle))
        level = brightness(shown[nearest])
        is_gap = learned is not None and level < GAP * dim
        return ObservedAppearance(
            marked=True,
            full=level > FULL * dim or is_gap,
            hidden=abs(nearest - middle) > len(shown) / 6.0,
            own=own,
            foreign=foreign,
        )


def _commonest(codes: Sequence[int]) -> int:
    return max(codes, key=codes.count)


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
        self._lights: dict[Key, list[Interval]] = {}
        """Parts of strips that are lights of things."""
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
        runs = [run for run in self._runs(kind) if self._part_at(run, kind, self._lights) != "end"]
        spans: dict[Key, list[Interval]] = {}
        if runs:
            for key, start_m, end_m in things:
                spans.setdefault(key, []).append((start_m, end_m))

        # A mark blinks. A dim pixel that stays is a narrow cursor.
        marks = [run for run in runs if self._is_mark(run)]
        self._dim_looks = self._dim_looks + 1 if marks else 0

        # The run with the least doubt
        best: tuple[float, _Run, Vec3] | None = None
        for run in runs:
            if run in marks and self._dim_looks <= BLINK_LOOKS:
                continue
            point_m = run.line.line.point_at(run.middle_m)
            part = self._part_at(run, kind, spans)
            cost = self._cost(run, point_m, part, expected_m)
            if best is None or cost < best[0]:
                best = (cost, run, point_m)

        # Without a likely one, a darker one may be seen next
        if best is None or best[0] > MAX_COST:
            self._brightness = max(DARKEST, self._brightness * ADAPTING)
            return None
        _, run, point_m = best
        self._full = self._share(run)
        return SeenCursor(run.line.kind, run.line.id, run.middle_m, point_m, run.width_m)

    def _cost(
        self, run: _Run, point_m: Vec3, part: Literal["", "end", "body"], expected_m: Vec3 | None
    ) -> float:
        """Return the doubt that a run at `point_m`, on the `part` of a thing, is the own cursor."""
        # By its width, of which less is known if it may be longer
        log_ratio = math.log(run.width_m / self._width_m)
        cost = abs(log_ratio) * 1.5
        if run.parts > 1:
            cost += 0.3
        if cost > 0.0 and _is_cut(run):
            cost /= 2.0

        # By its distance from where the hand feels to point
        if expected_m is not None:
            distance_cost = math.dist(point_m, expected_m) / SCALE_M
            cost += distance_cost if part == "end" else min(distance_cost, MAX_DISTANCE_COST)

        # By the thing whose margin or pattern it may be
        if part == "end":
            cost += 1.0 if run.width_m < NARROW * self._width_m else 0.5
        elif part and self._is_mixed:
            cost += 0.7
        return cost

    def mark(self, kind: Kind) -> Vec3 | None:
        """Return the position of the mark of a ray that passes everything, or None."""
        own = self._own_codes(MARK_SHARE[0] * self._full)
        for run in self._runs_of(own, kind):
            if self._is_mark(run):
                return run.line.line.point_at(run.middle_m)
        return None

    def _is_mark(self, run: _Run) -> bool:
        is_narrow = run.width_m < 1.5 * run.line.pitch_m
        return is_narrow and self._share(run) < MARK_SHARE[1] * self._full

    def _share(self, run: _Run) -> float:
        codes = self._decoded()
        return max(self._own.share(codes[pixel]) for pixel in run.pixels)

    def _part_at(
        self, run: _Run, kind: Kind, spans: Mapping[Key, Sequence[Interval]]
    ) -> Literal["", "end", "body"]:
        """Return the part of a thing on which a run is, on any belt."""
        part: Literal["", "body"] = ""
        middle_pixel = run.pixels[len(run.pixels) // 2]
        for line, at_m in self._pixels.places(middle_pixel, kind):
            for start_m, end_m in spans.get((line.kind, line.id), ()):
                to_nearest_end_m = min(at_m - start_m, end_m - at_m)
                if to_nearest_end_m < -END_M:
                    continue
                if to_nearest_end_m < 2.0 * END_M:
                    return "end"
                part = "body"
        return part

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
        shown = [codes[pixel] for pixel in line.at[first:last]]
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
        own: dict[int, float] = {}
        for code in codes:
            if not code:
                continue
            share = self._own.share(code)
            if share >= minimum:
                own[code] = share
        return own

    def _runs_of(self, own: Iterable[int], kind: Kind) -> list[_Run]:
        # Own pixels of each line, by arc length
        hits: dict[int, tuple[ShownLine, list[tuple[float, int]]]] = {}
        for code in own:
            for pixel in np.flatnonzero(self._array == code).tolist():
                for line, arc_m in self._pixels.places(pixel, kind):
                    _, lit = hits.setdefault(id(line), (line, []))
                    lit.append((arc_m, pixel))

        # Runs without gaps, and those whose gaps may be the colours of other cursors
        longest_m = TOO_WIDE * self._width_m
        runs: list[_Run] = []
        for line, lit in hits.values():
            lit.sort()
            single = _grouped(line, lit, 1.5)
            interleaved = _grouped(line, lit, INTERLEAVED)
            merged = [run._replace(parts=2) for run in interleaved if run not in single]
            max_m = longest_m + 2.0 * line.pitch_m
            for run in (*single, *merged):
                if run.width_m <= max_m:
                    runs.append(run)
        return runs

    def _decoded(self) -> list[int]:
        """Return the colour of every pixel as red * 65536 + green * 256 + blue. Missing ones are dark."""
        if self._codes is not None:
            return self._codes
        shown: dict[str, bytes] = {}
        if self._frame is not None:
            shown = {strip.id: strip.rgb for strip in self._frame.strips}
        parts: list[bytes] = []
        for name, count in self._pixels.strips:
            colors = shown.get(name, b"")
            if len(colors) != 3 * count:
                colors = bytes(3 * count)
            parts.append(colors)
        data = np.frombuffer(b"".join(parts), dtype=np.uint8)
        red, green, blue = data.reshape(-1, 3).astype(np.int32).T
        self._array = red * 65536 + green * 256 + blue
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
            first_m = arc_m
            pixels = []
        last_m = arc_m
        pixels.append(pixel)
    return [*runs, _Run(line, first_m, last_m, pixels, 1)]


def _is_cut(run: _Run) -> bool:
    """Return True if a run touches the first or last pixel of its line, so that it may be longer."""
    arcs_m = run.line.arcs_m
    return run.first_m <= arcs_m[0] or run.last_m >= arcs_m[-1]
