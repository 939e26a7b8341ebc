"""Current content of the strips: fresh messages, and the appearance of objects."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.array_types import Array, Indices
from pointit.geometry.colormap import colormap
from pointit.schemas import (
    NS_PER_S,
    Cursor,
    Hover,
    Passed,
    Selection,
    TrackedObject,
    TrackedObjects,
    UserProfile,
)
from pointit.schemas.base import Rgb
from pointit.schemas.expiring_dict import ExpiringDict
from pointit.schemas.pointing import LINES
from pointit.services.led_driver.config import LedDriverConfig, StyleConfig
from pointit.services.led_driver.render import (
    BODY,
    FILL,
    GAP,
    MARGIN,
    MARGIN_COLORS,
    OWNER,
    PATTERNS,
    ROLES,
    Bytes,
    CursorMark,
    Layout,
    Segments,
    tails,
)

NO_PROFILE = UserProfile(stamp_ns=0)
"""Profile of a person who has not published one: a white cursor, solid."""
WHITE: Rgb = (255, 255, 255)
BLINK_NS = NS_PER_S // 2
"""Time for which the pixel nearest to a ray that points past everything is lit, then dark: 1 Hz."""
PASSED_LEVEL = 0.5
"""Brightness of that pixel."""
CURSOR_RANGE_RAD = math.radians(10.0)
"""Angle at the start of a cursor's colormap, whose end is 0, rad."""
MOTION_PERIOD_NS = NS_PER_S // 25
"""Time after which moving objects are drawn again without a message, ns: some trackers send 5 a second."""
NO_CURSOR = Cursor(stamp_ns=0)


@dataclass(frozen=True, slots=True)
class Appearance:
    """Appearance of n objects, with the fields of `Segments`."""

    palette: Bytes
    progress: Array
    margins: Indices
    thin: np.ndarray[tuple[int], np.dtype[np.bool_]]
    patterns: Indices


@dataclass(slots=True)
class _State:
    """State of one object."""

    owner: str | None = None
    """User who has selected it."""
    claimant: str | None = None
    """User who has selected it while its carriers have not reported yet that it is on."""
    reserver: str | None = None
    """User who is about to select it."""
    hovers: dict[str, Hover] = field(default_factory=dict[str, Hover])


class AppearanceTable:
    """Maps kinds and states of objects to their appearance."""

    def __init__(self, style: StyleConfig) -> None:
        self._kinds = {kind: number + 1 for number, kind in enumerate(style.kind_colors)}
        colors = np.array([style.default_color, *style.kind_colors.values()], dtype=np.float64)
        self._bright = np.rint(colors).astype(np.uint8)
        self._dim = np.rint(colors * style.idle_level).astype(np.uint8)
        self._pending = np.rint(colors * style.pending_level).astype(np.uint8)
        self._gap = np.rint(colors * style.gap_level).astype(np.uint8)
        self._plain = np.zeros((len(colors), ROLES, 3), dtype=np.uint8)
        self._plain[:, BODY] = self._dim

    def kind(self, name: str) -> int:
        """Return the number of a kind, or 0 if it has no colour of its own."""
        return self._kinds.get(name, 0)

    def appearance(
        self,
        kinds: Indices,
        ids: Mapping[str, Sequence[int]],
        hovers: Mapping[str, Hover],
        selection: Selection | None,
        profiles: Mapping[str, UserProfile],
    ) -> Appearance:
        """Return the appearance of objects of `kinds`; `ids` has their indices, `hovers` is by user."""
        count = len(kinds)
        appearance = Appearance(
            palette=self._plain[kinds],
            progress=np.zeros(count),
            margins=np.zeros(count, dtype=np.intp),
            thin=np.zeros(count, dtype=np.bool_),
            patterns=np.zeros(count, dtype=np.intp),
        )
        for object_id, state in _states(hovers, selection).items():
            for index in ids.get(object_id, ()):
                self._apply_style(appearance, index, int(kinds[index]), state, profiles)
        return appearance

    def _apply_style(
        self,
        appearance: Appearance,
        index: int,
        kind: int,
        state: _State,
        profiles: Mapping[str, UserProfile],
    ) -> None:
        is_selected = state.owner is not None or state.claimant is not None
        palette = appearance.palette[index]
        body, fill = self._body_and_fill(kind, state)
        palette[BODY] = body
        palette[FILL] = fill
        palette[GAP] = self._gap[kind]

        # margins: the person who has the object first, then those who hover it
        dark = _color(self._gap[kind])
        colors = [profiles.get(user, NO_PROFILE).cursor_color for user in sorted(state.hovers)]
        if state.owner is not None:
            owner = profiles.get(state.owner, NO_PROFILE)
            palette[OWNER] = owner.cursor_color
            appearance.patterns[index] = PATTERNS.index(owner.pattern)
            colors = _with_owner(owner.cursor_color, colors, dark)
        elif state.claimant is not None:
            claimant = profiles.get(state.claimant, NO_PROFILE)
            colors = _with_owner(claimant.cursor_color, colors, dark)
        elif state.reserver is not None:
            color = profiles.get(state.reserver, NO_PROFILE).cursor_color
            appearance.thin[index] = not colors
            colors = [color, *_without(colors, color)]
        colors = colors[:MARGIN_COLORS]
        palette[MARGIN : MARGIN + len(colors)] = colors
        appearance.margins[index] = len(colors)

        # gauge: the person who is nearest to changing the object
        progress = 0.0
        for hover in state.hovers.values():
            if _changes(hover, selected=is_selected):
                progress = max(progress, hover.progress)
        appearance.progress[index] = progress

    def _body_and_fill(self, kind: int, state: _State) -> tuple[Bytes, Bytes]:
        """Return the colour of the body, and the one in which it fills with progress."""
        if state.owner is not None:
            return self._bright[kind], self._dim[kind]
        if state.claimant is not None:
            return self._pending[kind], self._dim[kind]
        return self._dim[kind], self._bright[kind]


def _with_owner(color: Rgb, hoverers: list[Rgb], dark: Rgb) -> list[Rgb]:
    """Return the margins of a selected object: the owner's colour first, so that it is the outermost."""
    others = _without(hoverers, color)
    if others or not hoverers:
        return [color, *others]
    # the owner hovers it: their colour beside itself would show nothing
    contrast = dark if color == WHITE else WHITE
    return [color, contrast]


def _without(colors: list[Rgb], color: Rgb) -> list[Rgb]:
    return [other for other in colors if other != color]


def _color(values: Bytes) -> Rgb:
    red, green, blue = values.tolist()
    return (red, green, blue)


def _changes(hover: Hover, *, selected: bool) -> bool:
    """Return True if completing `hover` would change the object."""
    action = "deselect" if selected else "select"
    return hover.action in {"", action}


def _states(hovers: Mapping[str, Hover], selection: Selection | None) -> dict[str, _State]:
    """Return the state of each object that has any, by id."""
    states: dict[str, _State] = {}
    if selection is not None:
        for reserved in selection.reserved:
            states.setdefault(reserved.id, _State()).reserver = reserved.user
        for item in selection.objects:
            state = states.setdefault(item.id, _State())
            if item.is_pending:
                state.claimant = item.user
            else:
                state.owner = item.user

    # A hover may report who is about to get the object before the selection does
    for user, hover in hovers.items():
        if hover.object_id:
            state = states.setdefault(hover.object_id, _State())
            state.hovers[user] = hover
            users = (state.owner, state.claimant, state.reserver)
            if hover.taken_by and users == (None, None, None):
                state.reserver = hover.taken_by
    return states


@dataclass(frozen=True, slots=True)
class _Placed:
    """Objects on the layout, as arrays, built on arrival rather than on drawing."""

    lines: Indices
    at_m: Array
    half_m: Array
    speed_mps: Array
    moves: bool
    """True if an object moves."""
    forth: NDArray[np.bool_]
    tail_m: tuple[Array, Array] | None
    stamp_ns: NDArray[np.int64]
    kinds: Indices
    ids: dict[str, list[int]]


class StripContent:
    """Stores received messages and drops expired ones. Ages count from arrival."""

    def __init__(self, config: LedDriverConfig) -> None:
        cursor_timeout_ns = int(config.cursor_timeout_s * NS_PER_S)
        self._objects_timeout_ns = int(config.objects_timeout_s * NS_PER_S)
        self._style = config.style
        self._appearances = AppearanceTable(config.style)
        self._layout = Layout(())
        self._cursors = ExpiringDict[str, Cursor](cursor_timeout_ns)
        self._hovers = ExpiringDict[str, Hover](cursor_timeout_ns)
        self._objects = ExpiringDict[str, TrackedObjects](self._objects_timeout_ns)
        self._profiles: dict[str, UserProfile] = {}
        self._selection: Selection | None = None
        self._new_ns: int | None = None
        self._blink_ns: int | None = None
        """Time of the next change of a blinking pixel, ns."""
        self._motion_ns: int | None = None
        """Time at which moving objects are drawn again, ns. None if no object moves."""
        self._placed: _Placed | None = None
        self._appearance: Appearance | None = None

    def set_layout(self, layout: Layout) -> None:
        """Draw on `layout` from now on."""
        self._layout = layout
        self._placed = self._appearance = None

    def set_cursor(self, user: str, cursor: Cursor, now_ns: int) -> bool:
        """Set `user`'s cursor. Return True if that changes the strips.

        It does if the cursor is or was on a line, or if another pixel is nearest to a ray past everything.
        """
        previous = self._cursors.get(user, NO_CURSOR)
        self._cursors.put(user, cursor, now_ns)
        if cursor.surface in LINES:
            self._new_ns = max(cursor.stamp_ns, self._new_ns or 0)
            return True
        if previous.surface in LINES:
            return True
        if cursor.passed == previous.passed:
            return False
        return self._pixels(cursor) != self._pixels(previous)

    def cursor_color(self, user: str) -> Rgb:
        """Return the colour of `user`'s cursor, or of their profile without one."""
        cursor = self._cursors.get(user, NO_CURSOR)
        return self._color(self._profiles.get(user, NO_PROFILE), cursor)

    def profile_color(self, user: str) -> Rgb:
        """Return the colour of `user`'s profile."""
        return self._profiles.get(user, NO_PROFILE).cursor_color

    @property
    def people_with_cursors(self) -> frozenset[str]:
        """People whose cursor had not expired at the last call of `forget`."""
        return frozenset(self._cursors)

    def set_hover(self, user: str, hover: Hover, now_ns: int) -> bool:
        """Set `user`'s hovered object. Return False if they hover nothing, as before: no pixel changes."""
        previous = self._hovers.get(user)
        self._hovers.put(user, hover, now_ns)
        has_hovered = previous is not None and bool(previous.object_id)
        if not hover.object_id and not has_hovered:
            return False
        self._appearance = None
        return True

    def set_objects(self, tracker: str, objects: TrackedObjects, now_ns: int) -> None:
        """Set all objects of `tracker`."""
        self._objects.put(tracker, objects, now_ns)
        self._placed = self._appearance = None

    def set_selection(self, selection: Selection) -> None:
        """Set the selection."""
        self._selection = selection
        self._appearance = None

    def set_profile(self, user: str, profile: UserProfile) -> None:
        """Set `user`'s colour, pattern and cursor width.

        Raises:
            UnknownColormapError: If there is no colormap of that name. The cursor keeps its colour.
        """
        self._profiles[user] = profile.model_copy(update={"cursor_colormap": ""})
        self._appearance = None
        if profile.cursor_colormap:
            colormap(profile.cursor_colormap)
            self._profiles[user] = profile

    def forget(self, now_ns: int) -> None:
        """Drop what has expired."""
        self._cursors.expire(now_ns)
        if self._hovers.expire(now_ns):
            self._appearance = None
        if self._objects.expire(now_ns):
            self._placed = self._appearance = None

    def next_change_ns(self) -> int | None:
        """Return the time of the next expiry without new messages, blink or step of a moving object."""
        changes_ns = [self._blink_ns, self._motion_ns]
        for expiring in (self._cursors, self._hovers, self._objects):
            changes_ns.append(expiring.next_expiry_ns())
        return min((change_ns for change_ns in changes_ns if change_ns is not None), default=None)

    def pop_newest_capture_ns(self) -> int | None:
        """Return the newest capture time of the cursors on lines that came since the last call."""
        new_ns = self._new_ns
        self._new_ns = None
        return new_ns

    def cursors(self, now_ns: int) -> list[CursorMark]:
        """Return the cursors on strips and belts, by user name, and the pixels nearest to passing rays."""
        marks: list[CursorMark] = []
        blinks = now_ns // BLINK_NS
        self._blink_ns = None
        for user in sorted(self._cursors):
            cursor = self._cursors[user]

            # The pixel nearest to a ray past everything blinks, all of them together
            passed_mark = None
            if cursor.passed is not None:
                passed_mark = self._passed_mark(user, cursor.passed)
            if passed_mark is not None:
                self._blink_ns = (blinks + 1) * BLINK_NS
                if blinks % 2 == 0:
                    marks.append(passed_mark)

            # The cursor itself, if it is on a line of the map
            if cursor.surface not in LINES:
                continue
            line = self._layout.line(cursor.surface, cursor.surface_id)
            if line is None:
                continue
            profile = self._profiles.get(user, NO_PROFILE)
            color = self._color(profile, cursor)
            marks.append(CursorMark(line, cursor.position_m, profile.cursor_width_m, color))
        return marks

    def _passed_mark(self, user: str, passed: Passed) -> CursorMark | None:
        """Return the mark of a person who points past everything: a dim pixel where they come nearest."""
        line = self._layout.line(passed.surface, passed.surface_id)
        if line is None:
            return None
        profile = self._profiles.get(user, NO_PROFILE)
        color = profile.cursor_color
        if profile.cursor_colormap:
            color = colormap(profile.cursor_colormap).rgb(0.0)
        red, green, blue = (round(value * PASSED_LEVEL) for value in color)
        return CursorMark(line=line, at_m=passed.position_m, width_m=0.0, color=(red, green, blue))

    def _pixels(self, cursor: Cursor) -> list[int]:
        """Return the numbers of the pixels that `_passed_mark` lights, one of each strip beside a belt."""
        passed = cursor.passed
        if passed is None:
            return []
        line = self._layout.line(passed.surface, passed.surface_id)
        if line is None:
            return []
        lines = np.array([line], dtype=np.intp)
        at_m = np.array([passed.position_m])
        _, entries = self._layout.lit(lines, at_m, at_m)
        return [int(pixel) for pixel in self._layout.pixels[entries]]

    def _color(self, profile: UserProfile, cursor: Cursor) -> Rgb:
        if not profile.cursor_colormap:
            return profile.cursor_color
        share = min(cursor.miss_rad / CURSOR_RANGE_RAD, 1.0)
        return colormap(profile.cursor_colormap).rgb(1.0 - share)

    def segments(self, now_ns: int) -> Segments:
        """Return the objects on strips and belts at their positions at `now_ns`."""
        # Positions and appearance are computed once for each change of theirs, not for each frame
        if self._placed is None:
            self._placed = self._place_objects()
        placed = self._placed
        if self._appearance is None:
            self._appearance = self._appearances.appearance(
                placed.kinds, placed.ids, self._hovers, self._selection, self._profiles
            )
        looks = self._appearance

        # Moving objects go on at their last speed until their tracker reports them again
        self._motion_ns = now_ns + MOTION_PERIOD_NS if placed.moves else None
        # never beyond the timeout, and a clock ahead of ours must not move them backwards
        age_ns = now_ns - placed.stamp_ns
        elapsed_ns = np.maximum(np.minimum(age_ns, self._objects_timeout_ns), 0)
        return Segments(
            lines=placed.lines,
            at_m=placed.at_m + placed.speed_mps * (elapsed_ns / NS_PER_S),
            half_m=placed.half_m,
            forth=placed.forth,
            tail_m=placed.tail_m,
            palette=looks.palette,
            progress=looks.progress,
            margins=looks.margins,
            thin=looks.thin,
            patterns=looks.patterns,
        )

    def _place_objects(self) -> _Placed:
        rows: list[tuple[int, TrackedObject, int]] = []
        for tracked in self._objects.values():
            rows += [(line, item, tracked.stamp_ns) for line, item in self._on_lines(tracked.objects)]
        rows.sort(key=lambda row: not row[1].lit)  # moving lights are drawn over a thing's light

        # An object may have several indices: several trackers may report it
        items = [item for _, item, _ in rows]
        ids: dict[str, list[int]] = {}
        for index, item in enumerate(items):
            ids.setdefault(item.id, []).append(index)

        # One array for each field, in the order of drawing
        lines = np.array([line for line, _, _ in rows], dtype=np.intp)
        stamps_ns = np.array([stamp_ns for _, _, stamp_ns in rows], dtype=np.int64)
        at_m = np.array([item.surface_position_m for item in items])
        half_m = np.array([item.length_m for item in items]) / 2.0
        speed_mps = np.array([item.surface_speed_mps for item in items])
        kinds = np.array([self._appearances.kind(item.kind) for item in items], dtype=np.intp)
        return _Placed(
            lines=lines,
            at_m=at_m,
            half_m=half_m,
            speed_mps=speed_mps,
            moves=bool(speed_mps.any()),
            forth=speed_mps >= 0.0,
            tail_m=tails(self._layout, lines, half_m, speed_mps, self._style),
            stamp_ns=stamps_ns,
            kinds=kinds,
            ids=ids,
        )

    def _on_lines(self, objects: Iterable[TrackedObject]) -> Iterable[tuple[int, TrackedObject]]:
        for item in objects:
            if item.surface in LINES:
                line = self._layout.line(item.surface, item.surface_id)
                if line is not None:
                    yield line, item
