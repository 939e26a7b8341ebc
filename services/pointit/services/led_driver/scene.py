"""What is to be seen on the strips now: the newest of everything, as long as it is fresh."""

from typing import TypeVar

from pointit.schemas import (
    NS_PER_S,
    Cursor,
    Hover,
    Selection,
    TrackedObject,
    TrackedObjects,
    UserProfile,
)
from pointit.services.led_driver.config import Color
from pointit.services.led_driver.render import CursorMark, ObjectMark

T = TypeVar("T")

_UNKNOWN = UserProfile(stamp_ns=0)


class Scene:
    """Keeps what was heard and forgets what has grown old; ages count from arrival."""

    def __init__(self, *, cursor_timeout_s: float = 0.5, objects_timeout_s: float = 1.0) -> None:
        self._cursor_timeout_ns = int(cursor_timeout_s * NS_PER_S)
        self._objects_timeout_ns = int(objects_timeout_s * NS_PER_S)
        self._cursors: dict[str, tuple[int, Cursor]] = {}
        self._hovers: dict[str, tuple[int, Hover]] = {}
        self._objects: dict[str, tuple[int, TrackedObjects]] = {}
        self._profiles: dict[str, UserProfile] = {}
        self._new_ns: int | None = None
        self._selected: frozenset[str] = frozenset()

    def set_cursor(self, user: str, cursor: Cursor, now_ns: int) -> None:
        """Take where `user` points."""
        self._cursors[user] = (now_ns, cursor)
        if cursor.surface == "strip":
            self._new_ns = max(cursor.stamp_ns, self._new_ns or 0)

    def set_hover(self, user: str, hover: Hover, now_ns: int) -> None:
        """Take what `user`'s cursor is on."""
        self._hovers[user] = (now_ns, hover)

    def set_objects(self, tracker: str, objects: TrackedObjects, now_ns: int) -> None:
        """Take all objects of `tracker`."""
        self._objects[tracker] = (now_ns, objects)

    def set_selection(self, selection: Selection) -> None:
        """Take what is selected."""
        self._selected = frozenset(item.id for item in selection.objects)

    def set_profile(self, user: str, profile: UserProfile) -> None:
        """Take `user`'s colour and cursor width."""
        self._profiles[user] = profile

    def forget(self, now_ns: int) -> None:
        """Drop what is too old, or came at a time still to come: the clock was set back."""
        _forget(self._cursors, now_ns, self._cursor_timeout_ns)
        _forget(self._hovers, now_ns, self._cursor_timeout_ns)
        _forget(self._objects, now_ns, self._objects_timeout_ns)

    def next_change_ns(self) -> int | None:
        """Return when something will be too old if nothing more is heard of it."""
        ends = [at + self._cursor_timeout_ns for at, _ in (*self._cursors.values(), *self._hovers.values())]
        ends += [at + self._objects_timeout_ns for at, _ in self._objects.values()]
        return min(ends, default=None)

    def take_new_ns(self) -> int | None:
        """Return the newest capture time of the cursors on strips that came since the last call."""
        new_ns, self._new_ns = self._new_ns, None
        return new_ns

    def cursors(self) -> list[CursorMark]:
        """Return the cursors on strips, by user name."""
        marks: list[CursorMark] = []
        for user in sorted(self._cursors):
            cursor = self._cursors[user][1]
            if cursor.surface == "strip":
                profile = self._profiles.get(user, _UNKNOWN)
                marks.append(
                    CursorMark(
                        strip_id=cursor.surface_id,
                        position_m=cursor.position_m,
                        width_m=profile.cursor_width_m,
                        color=profile.cursor_color,
                    )
                )
        return marks

    def objects(self, now_ns: int) -> list[ObjectMark]:
        """Return the objects on strips where they are at `now_ns`."""
        hovers = {
            hover.object_id: (hover.progress, self._profiles.get(user, _UNKNOWN).cursor_color)
            for user, (_, hover) in self._hovers.items()
            if hover.object_id
        }
        marks: list[ObjectMark] = []
        for _, tracked in self._objects.values():
            # never beyond the time-out, and a clock that is ahead of ours must not move them backwards
            elapsed_s = min(max(now_ns - tracked.stamp_ns, 0), self._objects_timeout_ns) / NS_PER_S
            marks += [
                self._mark(item, elapsed_s, hovers) for item in tracked.objects if item.surface == "strip"
            ]
        return marks

    def _mark(
        self, item: TrackedObject, elapsed_s: float, hovers: dict[str, tuple[float, Color]]
    ) -> ObjectMark:
        progress, hover_color = hovers.get(item.id, (0.0, None))
        return ObjectMark(
            strip_id=item.surface_id,
            position_m=item.surface_position_m + item.surface_speed_mps * elapsed_s,
            length_m=item.length_m,
            kind=item.kind,
            selected=item.id in self._selected,
            progress=progress,
            hover_color=hover_color,
        )


def _forget(heard: dict[str, tuple[int, T]], now_ns: int, timeout_ns: int) -> None:
    for name in [name for name, (at, _) in heard.items() if not 0 <= now_ns - at < timeout_ns]:
        del heard[name]
