"""What a person makes of the light on the strips: where their own cursor is, and what became of a thing.

The language of light: a thing is a segment in its kind's colour, dim while it is free, bright once selected;
its two ends show whose cursor is on it, or who selected it; a cursor is a short run in its person's colour,
on top of all, and cursors that meet alternate pixel by pixel. Nothing but the frame's bytes, the map, the
things themselves and one's own colour is used. A frame is decoded when somebody looks, not when it comes.
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.vector import Vec3
from pointit.schemas import Environment, StripsFrame, UserProfile
from pointit.services.user_sim.sight.colors import DARKEST, OwnColor
from pointit.services.user_sim.sight.observed_appearance import ObservedAppearance, UsualLooks
from pointit.services.user_sim.sight.pixels import Key, Kind, Pixels, ShownLine

LEVEL_SHARE = 0.8
"""A cursor is at least so bright, as a share of how bright it was lately."""
ADAPTING = 0.96
"""By how much less bright a cursor is looked for after each look in vain: the eyes adapt to dimmed strips."""
TOO_WIDE = 1.6
"""A run longer than this many cursors, and two pixels, is no cursor."""
INTERLEAVED = 4.5
"""Pixels between two of one's own where as many people's cursors meet as can be told apart."""
SCALE_M = 0.7
"""So far from where they feel to point a run is as doubtful as one of a third of the cursor's width."""
FARTHEST = 2.0
"""Doubt about a light that may be no thing's margin, however far it is from where they feel to point."""
LEAST_LIKELY = 2.6
"""Largest doubt at which a run still counts as a cursor."""
END_M = 0.06
"""So far beyond the end of a thing, and twice as far within, a run may be its margin: that is broader
in a curve, and where a cursor touches it."""
NARROW = 0.8
"""Share of the cursor's width below which a run is more likely a margin than a cursor."""
MARK_SHARE = (0.3, 0.7)
"""Brightness of the pixel that shows where one points past, as a share of one's cursor."""
BLINK_LOOKS = 8
"""A dim pixel that was seen so many times in a row does not blink: it is a narrow cursor."""
MIXED_PATTERNS = ("striped", "tailed")
"""They put the owner's colour into the body of what is theirs."""
Span = tuple[Key, float, float]
"""A line, and from where to where on it a thing lies."""


class SeenCursor(NamedTuple):
    """One's own cursor."""

    kind: Kind
    line_id: str
    position_m: float
    """Along the strip, or along the belt beside it."""
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
    """Looks at frames of one room for one person."""

    def __init__(self) -> None:
        """Open them: there is nothing to see yet."""
        self._pixels = Pixels(Environment(stamp_ns=0, name="nothing"))
        self._frame: StripsFrame | None = None
        self._codes: list[int] | None = None
        self._array: NDArray[np.int32] = np.empty(0, dtype=np.int32)
        """The pixels of `_codes`, for searching."""
        self._brightness = 1.0
        """Brightness of recently seen cursors, a share of full brightness."""
        self._full = 1.0
        """Brightness of the last cursor, a share of full brightness."""
        self._dim_looks = 0
        self._usual_looks = UsualLooks()
        self.set_profile(UserProfile(stamp_ns=0))

    def learn(self, room: Environment) -> None:
        """Look around in `room`."""
        self._pixels = Pixels(room)
        self._codes = None

    def set_profile(self, profile: UserProfile) -> None:
        """Know one's own colour, or colours, and how wide one's cursor is."""
        self._own = OwnColor(profile)
        self._width_m = profile.cursor_width_m
        self._is_mixed = profile.pattern in MIXED_PATTERNS

    def open(self, frame: StripsFrame) -> None:
        """Have `frame` before the eyes; nothing is made of it yet."""
        self._frame = frame
        self._codes = None

    def line(self, key: Key) -> ShownLine | None:
        """Return how the strip or belt `key` is shown, or none."""
        return self._pixels.lines.get(key)

    def cursor(
        self, kind: Kind, expected_m: Vec3 | None = None, things: Iterable[Span] = ()
    ) -> SeenCursor | None:
        """Return where one's own cursor is, or none that could be it.

        Args:
            kind: belt: what is seen beside a belt is on the belt; strip: on the strip.
            expected_m: where the hand is felt to point, {W}.
            things: where things lie, as their margins may have the same colour.
        """
        runs = self._runs(kind)
        best: tuple[float, _Run, Vec3] | None = None
        lying: dict[Key, list[tuple[float, float]]] = {}
        for key, start_m, end_m in things if runs else ():
            lying.setdefault(key, []).append((start_m, end_m))
        marks = [run for run in runs if self._is_mark(run)]
        self._dim_looks = self._dim_looks + 1 if marks else 0
        for run in runs:
            if run in marks and self._dim_looks <= BLINK_LOOKS:
                continue
            doubt = abs(math.log(run.width_m / self._width_m)) * 1.5 + 0.3 * (run.parts > 1)
            if doubt > 0.0 and _is_cut(run):
                doubt /= 2.0
            point_m = run.line.line.point_at(run.middle_m)
            where = self._where(run, kind, lying)
            if expected_m is not None:
                far = math.dist(point_m, expected_m) / SCALE_M
                doubt += far if where == "end" else min(far, FARTHEST)
            if where == "end":
                doubt += 1.0 if run.width_m < NARROW * self._width_m else 0.5
            elif where and self._is_mixed:
                doubt += 0.7
            if best is None or doubt < best[0]:
                best = (doubt, run, point_m)
        if best is None or best[0] > LEAST_LIKELY:
            self._brightness = max(DARKEST, self._brightness * ADAPTING)
            return None
        _, run, point_m = best
        self._full = self._share(run)
        return SeenCursor(run.line.kind, run.line.id, run.middle_m, point_m, run.width_m)

    def mark(self, kind: Kind) -> Vec3 | None:
        """Return where a dim pixel in one's own colour is, which shows that one points past, or None."""
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
        """Return on which part of a thing a run of light is, whichever belt the thing lies on."""
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
        """Return how a thing of `kind` looks whose middle is at `position_m` of line `key`.

        None when the strips do not show enough of it.
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
        """Return runs of pixels that may be one's own cursor, those interleaved with others' as one."""
        own = self._own_codes(LEVEL_SHARE * self._brightness)
        if own:
            self._brightness += 0.3 * (max(own.values()) - self._brightness)
        return self._runs_of(own, kind)

    def _own_codes(self, least: float) -> dict[int, float]:
        """Return the colours before the eyes that may be one's own, and how bright each is."""
        codes = set(self._decoded())
        return {code: share for code in codes if code and (share := self._own.share(code)) >= least}

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
            most_m = longest_m + 2.0 * line.pitch_m
            runs += [run for run in (*single, *merged) if run.width_m <= most_m]
        return runs

    def _decoded(self) -> list[int]:
        """Return the colour of every pixel as red * 65536 + green * 256 + blue; what is missing is dark."""
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
    """Return True if a run touches the first or last pixel of its line, so that a part of it is not seen."""
    return run.first_m <= run.line.arcs_m[0] or run.last_m >= run.line.arcs_m[-1]
