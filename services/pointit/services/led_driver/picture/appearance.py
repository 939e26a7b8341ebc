"""Appearance of objects: hovered, owned or reserved, as colours, gauge and pattern."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pointit.schemas import Hover, Selection, UserProfile
from pointit.schemas.base import Rgb
from pointit.services.led_driver.config import StyleConfig
from pointit.services.led_driver.picture.layout import Array, Indices
from pointit.services.led_driver.picture.render import (
    BODY,
    FILL,
    GAP,
    MARGIN,
    MARGIN_COLORS,
    OWNER,
    PATTERNS,
    ROLES,
    Bytes,
)

NO_PROFILE = UserProfile(stamp_ns=0)
"""Profile of a person who has not published one: a white cursor, solid."""
WHITE: Rgb = (255, 255, 255)


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
    reserver: str | None = None
    hovers: dict[str, Hover] = field(default_factory=dict[str, Hover])


class AppearanceTable:
    """Maps kinds and states of objects to their appearance."""

    def __init__(self, style: StyleConfig) -> None:
        self._style = style
        self._kinds = {kind: number + 1 for number, kind in enumerate(style.kind_colors)}
        colors = np.array([style.default_color, *style.kind_colors.values()], dtype=np.float64)
        self._bright = np.rint(colors).astype(np.uint8)
        self._dim = np.rint(colors * style.idle_level).astype(np.uint8)
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
        appearance = Appearance(
            self._plain[kinds],
            np.zeros(len(kinds)),
            np.zeros(len(kinds), dtype=np.intp),
            np.zeros(len(kinds), dtype=np.bool_),
            np.zeros(len(kinds), dtype=np.intp),
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
        selected = state.owner is not None
        palette = appearance.palette[index]
        levels = (self._dim[kind], self._bright[kind])
        palette[BODY] = levels[selected]
        palette[FILL] = levels[not selected]
        palette[GAP] = self._gap[kind]
        colors = [profiles.get(user, NO_PROFILE).cursor_color for user in sorted(state.hovers)]
        if state.owner is not None:
            owner = profiles.get(state.owner)
            color = self._style.unknown_owner_color if owner is None else owner.cursor_color
            palette[OWNER] = color
            appearance.patterns[index] = 0 if owner is None else PATTERNS.index(owner.pattern)
            colors = _with_owner(color, colors, _color(self._gap[kind]))
        elif state.reserver is not None:
            color = profiles.get(state.reserver, NO_PROFILE).cursor_color
            appearance.thin[index] = not colors
            colors = [color, *(each for each in colors if each != color)]
        colors = colors[:MARGIN_COLORS]
        palette[MARGIN : MARGIN + len(colors)] = colors
        appearance.margins[index] = len(colors)
        appearance.progress[index] = max(
            (hover.progress for hover in state.hovers.values() if _changes(hover, selected=selected)),
            default=0.0,
        )


def _with_owner(color: Rgb, hoverers: list[Rgb], dark: Rgb) -> list[Rgb]:
    """Return the margins of a selected object: the owner's colour first, so that it is the outermost."""
    others = [each for each in hoverers if each != color]
    if others or not hoverers:
        return [color, *others]
    # the owner hovers it: their colour beside itself would show nothing
    return [color, dark if color == WHITE else WHITE]


def _color(values: Bytes) -> Rgb:
    red, green, blue = values.tolist()
    return (red, green, blue)


def _changes(hover: Hover, *, selected: bool) -> bool:
    """Return True if completing `hover` would change the object."""
    return hover.action in {"", "deselect" if selected else "select"}


def _states(hovers: Mapping[str, Hover], selection: Selection | None) -> dict[str, _State]:
    states: dict[str, _State] = {}
    if selection is not None:
        for reserved in selection.reserved:
            states.setdefault(reserved.id, _State()).reserver = reserved.user
        for item in selection.objects:
            states.setdefault(item.id, _State()).owner = item.user
    for user, hover in hovers.items():
        if hover.object_id:
            state = states.setdefault(hover.object_id, _State())
            state.hovers[user] = hover
            if hover.taken_by and state.owner is None and state.reserver is None:
                state.reserver = hover.taken_by
    return states
