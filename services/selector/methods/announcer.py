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
        previous = self._cursor
        if previous is not None and cursor.stamp_ns - previous.stamp_ns > MAX_CURSOR_AGE_NS:
            self._is_due = True
        self._cursor = cursor

        # The focus ends when the ray has moved away
        if self._focus is None:
            return progress
        object_id, start = self._focus
        start_ray = start.direction
        ray = cursor.direction
        if start_ray is None or ray is None or vector.angle_between(start_ray, ray) > FOCUS_RAD:
            self._focus = None
            return progress

        # Its object fires once, after a longer time than by pointing, or waits for a press
        spent_ns = max(cursor.stamp_ns - start.stamp_ns, 0)
        full_ns = UNDERSTOOD_NS if self.is_pressed else STEP_DWELL_NS
        share = min(spent_ns / full_ns, 1.0)
        if self._has_fired or not acts(object_id):
            return SelectionProgress(object_id)
        self._has_fired = share == 1.0 and not self.is_pressed
        fired = object_id if self._has_fired else None
        return SelectionProgress(object_id, share, fired, spent_ns / NS_PER_S)

    def step(self, objects: Iterable[TrackedObject], step: Step) -> tuple[str, int]:
        """Move from the hovered object by `step`, or to the nearest one. At the end it is spoken again.

        Return the object and the time, ns. The object is `""` if the person does not point or there is none.
        """
        cursor = self._cursor
        objects = list(objects)
        if cursor is None:
            return "", 0
        if cursor.direction is None or cursor.origin_m is None:
            return "", 0
        if abs(step.stamp_ns - cursor.stamp_ns) > MAX_CURSOR_AGE_NS:
            return "", 0
        object_id = neighbour(objects, cursor, self._hovered, step)
        if not object_id:
            return "", cursor.stamp_ns

        # Stay on the object as if it had been hovered for long enough to speak its name
        self._place = ""
        if step.to == "here":
            rows = rows_of(objects, cursor.origin_m)
            self._place = place_in(rows, object_id)
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
        # Start with the object if another one was hovered before, or no press can mean its name any more
        name = self._names.get(object_id)
        is_lost = name is not None and stamp_ns - name.hovered_ns > RECENT_NS
        if is_lost:
            del self._names[object_id]
        elif name is not None:
            self._names[object_id] = name._replace(hovered_ns=stamp_ns)
        if is_lost or object_id != self._hovered:
            self._hovered = object_id
            self._hovered_ns = stamp_ns
            self._spoken = ("", 0)
            self._repeat_ns = None

        # Its name, for the first time or once more
        if self._announced.seq and stamp_ns - self._announced.stamp_ns < MIN_PERIOD_NS:
            return None
        if object_id:
            is_first = not self._spoken[0] and stamp_ns - self._hovered_ns >= FIRST_NS
            is_repetition = self._repeat_ns is not None and stamp_ns >= self._repeat_ns
            if is_first or is_repetition:
                return self._announce_name(object_id, label, stamp_ns, is_first=is_first)

        # Or the end of what was announced, or that names are spoken here
        has_ended = self._announced.object_id not in ("", object_id)
        if self._is_due or has_ended:
            return self._new_message(stamp_ns)
        return None

    def _announce_name(self, object_id: str, label: str, stamp_ns: int, *, is_first: bool) -> Announced:
        """Return the message of a name, and note from when on a press can mean it."""
        self._repeat_ns = None
        if is_first:
            self._spoken = (object_id, stamp_ns)
            self._repeat_ns = stamp_ns + REPEAT_NS
        for named_id, name in list(self._names.items()):
            if name.hovered_ns < stamp_ns - RECENT_NS:
                del self._names[named_id]
        name = self._names.setdefault(object_id, _Name(stamp_ns, stamp_ns, stamp_ns))
        if is_first:
            self._names[object_id] = name._replace(spoken_ns=stamp_ns)
        if self._place:
            label = f"{label}, {self._place}"[:MAX_ID]
            self._place = ""
        return self._new_message(stamp_ns, object_id, label)

    def is_silent(self, now_ns: int) -> bool:
        """Return True if something is announced and no cursor came for `MAX_CURSOR_AGE_NS`."""
        if not self._announced.object_id or self._cursor is None:
            return False
        return now_ns - self._cursor.stamp_ns > MAX_CURSOR_AGE_NS

    def confirmed(self, press_ns: int) -> str:
        """Return the object that a press means: its name could be understood, and it was hovered until now.

        `""` if there is none, or if its name began too long ago, which is then spoken again.
        """
        hovered_ns: dict[str, int] = {}
        for object_id, name in self._names.items():
            is_understood = name.began_ns <= press_ns - UNDERSTOOD_NS
            if is_understood and name.hovered_ns >= press_ns - RECENT_NS:
                hovered_ns[object_id] = name.hovered_ns
        if not hovered_ns:
            return ""
        newest_id = max(hovered_ns, key=hovered_ns.__getitem__)

        # Too late for an intended press: speak the name again, and wait for the next one
        if press_ns - self._names[newest_id].spoken_ns > self._confirm_within_ns:
            del self._names[newest_id]
            if self._spoken[0] == newest_id:
                self._repeat_ns = press_ns
            return ""
        return newest_id

    def _new_message(self, stamp_ns: int, object_id: str = "", label: str = "") -> Announced:
        """Return the next message, about an object or none, as the last one."""
        self._is_due = False
        began_ns = stamp_ns if object_id else 0
        seq = self._announced.seq + 1
        self._announced = Announced(
            stamp_ns=stamp_ns, seq=seq, object_id=object_id, label=label, began_ns=began_ns
        )
        return self._announced
