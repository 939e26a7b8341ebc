"""Announcer of one person: the object whose name is spoken to them, and the one that a press confirms."""

import math
from collections.abc import Callable, Iterable
from typing import Literal, NamedTuple

from pydantic import Field

from pointit.geometry import vector
from pointit.runtime.config.config import Config
from pointit.schemas import NS_PER_S, Announced, Cursor, Step, TrackedObject
from pointit.schemas.base import MAX_ID
from pointit.services.selector.methods.rows import neighbour, place_in, rows_of
from pointit.services.selector.selection_methods import SelectionProgress

FIRST_NS = NS_PER_S // 5
"""Time of steady hover after which the name is spoken, ns."""
REPEAT_NS = 3 * NS_PER_S // 2
"""Time from the beginning of the name to its repetition, ns."""
MIN_PERIOD_NS = NS_PER_S // 5
"""Minimum time between two messages, ns."""
UNDERSTOOD_NS = 3 * NS_PER_S // 5
"""Time from the beginning of a name to the first press that can mean it, ns."""
RECENT_NS = 2 * NS_PER_S // 5
"""Time for which a press can still mean an object that is no longer hovered, ns: pressing moves the arm."""
MAX_CURSOR_AGE_NS = NS_PER_S
"""Time without cursors after which nothing is announced any more, ns."""
FOCUS_RAD = math.radians(12.0)
"""Angle by which the ray has to turn before it decides again, after a step."""
STEP_DWELL_NS = 11 * NS_PER_S // 5
"""Dwell time of a person without a button on an object that they stepped to, ns."""


class AnnounceConfig(Config):
    """Names of objects that are spoken to people who see no lights."""

    people: tuple[str, ...] = Field(
        default=(),
        description="people to whom the name of the object that they point at is spoken, `*` for all, "
        "by their page, phone or a speaker that follows the topic `announced`",
    )
    confirm: Literal["press", "dwell"] = Field(
        default="press",
        description="press: their button selects the object whose name they heard; dwell: they have none, "
        "and staying on it selects",
    )
    confirm_within_s: float = Field(
        default=2.3,
        ge=1.0,
        le=600,
        description="time from the beginning of a name to the last press that confirms it, s. A later press "
        "has the name spoken again, and the next one confirms: an accidental press selects less often",
    )

    def is_for(self, user: str) -> bool:
        """Return True if names are spoken to `user`."""
        return user in self.people or "*" in self.people


class _Name(NamedTuple):
    began_ns: int
    """Time of the first name in the present reach: a short hover of a neighbour does not delay a press."""
    hovered_ns: int
    """Last time at which the object was hovered."""
    spoken_ns: int
    """Time from which a press confirms until `confirm_within_s`: a repetition does not extend it."""


class Announcer:
    """Names for one person. Stamps of cursors are its clock."""

    def __init__(self, config: AnnounceConfig) -> None:
        """Create with nothing announced."""
        self.is_pressed = config.confirm == "press"
        self._confirm_within_ns = round(config.confirm_within_s * NS_PER_S)
        self._announced = Announced(stamp_ns=0)
        self.forget()

    def forget(self) -> None:
        """Forget the pointing: the clock of its cursors was set back."""
        self._announced = self._announced.model_copy(update={"stamp_ns": 0})
        self._hovered = ""
        """Hovered object."""
        self._hovered_ns = 0
        """Time since which it is hovered."""
        self._spoken = ("", 0)
        self._repeat_ns: int | None = None
        """Time at which the name of the hovered object is repeated."""
        self._names: dict[str, _Name] = {}
        """Names of recently hovered objects."""
        self._focus: tuple[str, Cursor] | None = None
        """Object that the person stepped to, and the cursor of that time."""
        self._has_fired = False
        self._place = ""
        """Place of the object in its row, which the person asked for: it is spoken after the next name."""
        self._cursor: Cursor | None = None
        self._is_due = True
        """A message is due that says that names are spoken to the person, who begins to point."""

    @property
    def spoken(self) -> tuple[str, int]:
        """Return the hovered object and the time at which its name began, or an empty id."""
        return self._spoken

    def apply_focus(
        self, progress: SelectionProgress, cursor: Cursor, acts: Callable[[str], bool]
    ) -> SelectionProgress:
        """Return `progress` of a method, or that of the object stepped to until the ray has moved away.

        `acts` returns True if selecting an object has an effect.
        """
        # pages and phones forget somebody who leaves
        self._is_due |= (
            self._cursor is not None and cursor.stamp_ns - self._cursor.stamp_ns > MAX_CURSOR_AGE_NS
        )
        self._cursor = cursor
        if self._focus is None:
            return progress
        object_id, start = self._focus
        start_ray = start.direction
        ray = cursor.direction
        if start_ray is None or ray is None or vector.angle_between(start_ray, ray) > FOCUS_RAD:
            self._focus = None
            return progress
        spent_ns = max(cursor.stamp_ns - start.stamp_ns, 0)
        share = min(spent_ns / (UNDERSTOOD_NS if self.is_pressed else STEP_DWELL_NS), 1.0)
        if self._has_fired or not acts(object_id):
            return SelectionProgress(object_id)
        self._has_fired = share == 1.0 and not self.is_pressed
        fired = object_id if self._has_fired else None
        return SelectionProgress(object_id, share, fired, spent_ns / NS_PER_S)

    def step(self, objects: Iterable[TrackedObject], step: Step) -> tuple[str, int]:
        """Move from the hovered object as `step` says, or to the nearest one. At the end it is spoken again.

        Return the object and the time, ns. The object is `""` if the person does not point or there is none.
        """
        cursor = self._cursor
        objects = list(objects)
        if cursor is None or cursor.direction is None or cursor.origin_m is None:
            return "", 0
        if abs(step.stamp_ns - cursor.stamp_ns) > MAX_CURSOR_AGE_NS:
            return "", 0
        object_id = neighbour(objects, cursor, self._hovered, step)
        if object_id:
            self._place = place_in(rows_of(objects, cursor.origin_m), object_id) if step.to == "here" else ""
            self._focus = (object_id, cursor)
            self._has_fired = False
            self._hovered = object_id
            self._hovered_ns = cursor.stamp_ns - FIRST_NS
            self._spoken = ("", 0)
            self._repeat_ns = None
            self._names.clear()  # who steps on does not mean what was announced before
        return object_id, cursor.stamp_ns

    def announce(self, object_id: str, label: str, stamp_ns: int) -> Announced | None:
        """Return the message that is due while `object_id` is hovered, `""` for none. None if none is due."""
        name = self._names.get(object_id)
        is_lost = name is not None and stamp_ns - name.hovered_ns > RECENT_NS  # no press can mean it any more
        if is_lost:
            del self._names[object_id]
        elif name is not None:
            self._names[object_id] = name._replace(hovered_ns=stamp_ns)
        if is_lost or object_id != self._hovered:
            self._hovered = object_id
            self._hovered_ns = stamp_ns
            self._spoken = ("", 0)
            self._repeat_ns = None
        if self._announced.seq and stamp_ns - self._announced.stamp_ns < MIN_PERIOD_NS:
            return None
        is_first = not self._spoken[0] and stamp_ns - self._hovered_ns >= FIRST_NS
        if object_id and (is_first or (self._repeat_ns is not None and stamp_ns >= self._repeat_ns)):
            return self._speak(object_id, label, stamp_ns, is_first=is_first)
        has_ended = self._announced.object_id not in ("", object_id)
        return self._send(stamp_ns) if self._is_due or has_ended else None

    def _speak(self, object_id: str, label: str, stamp_ns: int, *, is_first: bool) -> Announced:
        self._repeat_ns = None
        if is_first:
            self._spoken = (object_id, stamp_ns)
            self._repeat_ns = stamp_ns + REPEAT_NS
        since_ns = stamp_ns - RECENT_NS
        self._names = {each: name for each, name in self._names.items() if name.hovered_ns >= since_ns}
        name = self._names.setdefault(object_id, _Name(stamp_ns, stamp_ns, stamp_ns))
        if is_first:
            self._names[object_id] = name._replace(spoken_ns=stamp_ns)
        if self._place:
            label = f"{label}, {self._place}"[:MAX_ID]
            self._place = ""
        return self._send(stamp_ns, object_id, label)

    def is_silent(self, now_ns: int) -> bool:
        """Return True if something is announced and no cursor came for `MAX_CURSOR_AGE_NS`."""
        cursor = self._cursor
        return (
            bool(self._announced.object_id)
            and cursor is not None
            and now_ns - cursor.stamp_ns > MAX_CURSOR_AGE_NS
        )

    def confirmed(self, press_ns: int) -> str:
        """Return the object that a press means: its name could be understood, and it was hovered until now.

        `""` if there is none, or if its name began too long ago, which is then spoken again.
        """
        names = {
            object_id: name.hovered_ns
            for object_id, name in self._names.items()
            if name.began_ns <= press_ns - UNDERSTOOD_NS and name.hovered_ns >= press_ns - RECENT_NS
        }
        object_id = max(names, key=names.__getitem__, default="")
        if object_id and press_ns - self._names[object_id].spoken_ns > self._confirm_within_ns:
            del self._names[object_id]
            if self._spoken[0] == object_id:
                self._repeat_ns = press_ns
            return ""
        return object_id

    def _send(self, stamp_ns: int, object_id: str = "", label: str = "") -> Announced:
        self._is_due = False
        began_ns = stamp_ns if object_id else 0
        seq = self._announced.seq + 1
        self._announced = Announced(
            stamp_ns=stamp_ns, seq=seq, object_id=object_id, label=label, began_ns=began_ns
        )
        return self._announced
