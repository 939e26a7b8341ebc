"""Pointing acts and selections of people, one row each. Pure: messages go in, rows come out.

A pointing act is the time for which a person's cursor stays on one object. It outlasts gaps of `GAP_S`, as
tremor carries a cursor over an object's edge and back.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from pointit.schemas import NS_PER_S, ActOutcome, Cursor, Hover, SelectionEvent, TrackedObjects
from pointit.schemas.base import SchemaModel

Outcome = Literal["selected", "deselected", "refused", "none"]

Seconds = Annotated[float, Field(description="since the recording began")]

GAP_S = 0.3
"""An act goes on if the cursor returns to its object within this time."""

AFTER_S = 1.0
"""An event this long after an act can still be its result: presses of a button come late."""

MAX_SELECTED = 10_000
"""Selections that are followed at once; of more, the oldest are written as they are."""

MAX_TRACKERS = 256
"""Trackers whose objects have kinds; a hostile file may have thousands."""


class PointingAct(SchemaModel):
    """One pointing act: a row of `acts.csv`."""

    user: Annotated[str, Field(description="pointing user")]
    begin_s: Annotated[Seconds, Field(description="cursor on the object, since the recording began")]
    end_s: Annotated[Seconds, Field(description="cursor last on the object, since the recording began")]
    begin_ns: Annotated[int, Field(description="begin_s as Unix time")]
    duration_s: Annotated[float, Field(description="end_s less begin_s")]
    object_id: Annotated[str, Field(description="the object pointed at")]
    object_kind: Annotated[str, Field(description="its kind; empty if it was not tracked")]
    outcome: Annotated[Outcome, Field(description="result of the act")]
    outcome_after_s: Annotated[float | None, Field(description="from begin_s to the outcome")]
    cause: Annotated[str, Field(description="trigger that completed it: dwell, button ...")]
    confidence: Annotated[float | None, Field(description="probability that this object was meant")]
    progress: Annotated[float, Field(description="largest share of the dwell that was reached, 0 to 1")]
    surface: Annotated[str, Field(description="kind of surface under the cursor at begin_s")]
    surface_id: Annotated[str, Field(description="that surface")]
    range_m: Annotated[float | None, Field(description="mean distance from the eyes to the cursor")]
    miss_rad: Annotated[float | None, Field(description="smallest angle between ray and object; 0: on it")]


class SelectionCsvRow(SchemaModel):
    """One selection, from its beginning to its end: a row of `selections.csv`."""

    user: Annotated[str, Field(description="selecting user")]
    object_id: Annotated[str, Field(description="the object")]
    object_kind: Annotated[str, Field(description="its kind")]
    selected_s: Annotated[Seconds, Field(description="when, since the recording began")]
    selected_ns: Annotated[int, Field(description="selected_s as Unix time")]
    pointed_s: Annotated[
        float | None, Field(description="time on the object before it was selected; empty if not pointed at")
    ]
    cause: Annotated[str, Field(description="action that selected it: dwell, button, undo ...")]
    confidence: Annotated[float | None, Field(description="probability that this object was meant")]
    range_m: Annotated[float | None, Field(description="mean distance from the eyes to the cursor")]
    miss_rad: Annotated[float | None, Field(description="smallest angle between ray and object; 0: on it")]
    ended_by: Annotated[
        Literal["deselected", "left", "dispatched", "failed", "recording"],
        Field(description="cause of the end; failed: its act was not done; recording: it was still selected"),
    ] = "recording"
    ended_s: Annotated[float | None, Field(description="when, since the recording began")] = None
    ended_user: Annotated[str, Field(description="deselecting user")] = ""
    kept_s: Annotated[float | None, Field(description="ended_s less selected_s")] = None
    bay: Annotated[str, Field(description="bay to which it was dispatched, if it was")] = ""


@dataclass
class _OpenAct:
    object_id: str
    kind: str
    begin_ns: int
    last_ns: int
    surface: str = ""
    surface_id: str = ""
    progress: float = 0.0
    miss_rad: float | None = None
    range_sum_m: float = 0.0
    ranges: int = 0
    event: SelectionEvent | None = None

    @property
    def range_m(self) -> float | None:
        return self.range_sum_m / self.ranges if self.ranges else None


class ActDetector:
    """Follows everybody through a recording. Rows are collected in lists that the caller clears."""

    def __init__(self, began_ns: int) -> None:
        self._began_ns = began_ns
        self._acts: dict[str, _OpenAct] = {}
        self._ended_acts: dict[str, _OpenAct] = {}
        """Each person's last act: an event about it may come after its end."""
        self._cursors: dict[str, Cursor] = {}
        self._objects: dict[str, TrackedObjects] = {}
        self._selected: dict[str, SelectionCsvRow] = {}
        self._pending: dict[tuple[str, int], SelectionCsvRow | None] = {}
        """Events without the final result of their carriers: selection that is over, by object and stamp."""
        self.acts: list[PointingAct] = []
        """Acts that are over."""
        self.selections: list[SelectionCsvRow] = []
        """Selections that are over."""

    def on_objects(self, tracker: str, message: TrackedObjects) -> None:
        """Know the kinds of objects."""
        if tracker in self._objects or len(self._objects) < MAX_TRACKERS:
            self._objects[tracker] = message

    def on_cursor(self, user: str, cursor: Cursor) -> None:
        """Measure the distance of what is pointed at."""
        self._cursors[user] = cursor
        act = self._acts.get(user)
        if act is not None and cursor.point_m is not None:
            act.range_sum_m += cursor.range_m
            act.ranges += 1

    def on_hover(self, user: str, hover: Hover) -> None:
        """Begin, continue or end an act."""
        act = self._acts.get(user)
        now_ns = hover.stamp_ns
        if act is not None:
            is_over = now_ns - act.last_ns > GAP_S * NS_PER_S
            if is_over or hover.object_id not in ("", act.object_id):
                self._end(user)
                act = None
        if not hover.object_id:
            return
        if act is None:
            act = self._begin(user, hover.object_id, now_ns)
        act.last_ns = max(act.last_ns, now_ns)
        act.progress = max(act.progress, hover.progress)
        if hover.miss_rad is None:
            return
        if act.miss_rad is None:
            act.miss_rad = hover.miss_rad
        else:
            act.miss_rad = min(act.miss_rad, hover.miss_rad)

    def on_event(self, event: SelectionEvent) -> None:
        """Note what came of an act, and begin or end a selection."""
        has_pending_result = bool(event.carriers) and not event.takes_back
        if has_pending_result and len(self._pending) < MAX_SELECTED:
            self._pending[event.object_id, event.stamp_ns] = None

        # An event that pointing caused is the result of an act.
        act = None
        is_by_pointing = event.cause in ("", "dwell", "button") and not event.takes_back
        if is_by_pointing and event.event in ("selected", "deselected", "refused"):
            act = self._open_act(event)

        if event.event == "selected":
            self._close_selection(event)  # taken over
            self._selected[event.object_id] = self._selection(event, act)
            if len(self._selected) > MAX_SELECTED:
                oldest = next(iter(self._selected))
                self.selections.append(self._selected.pop(oldest))
        elif event.event != "refused":
            self._close_selection(event)

    def on_outcome(self, outcome: ActOutcome) -> None:
        """Note the result of an event with carriers: what failed was refused, and selected nothing."""
        if outcome.result == "started":
            return
        key = outcome.object_id, outcome.event_ns
        row = self._pending.pop(key, None)
        if outcome.result == "failed":
            self._refuse_acts(key)
            if row is not None:
                row = row.model_copy(update={"ended_by": "failed"})
        if row is not None:
            self.selections.append(row)

    def _refuse_acts(self, key: tuple[str, int]) -> None:
        """Make the event of `key`, object and stamp, a refusal in the acts that it completed."""
        for act in (*self._acts.values(), *self._ended_acts.values()):
            event = act.event
            if event is not None and (event.object_id, event.stamp_ns) == key:
                act.event = event.model_copy(update={"event": "refused"})

    def end(self) -> None:
        """End everything: the recording is over."""
        for user in {**self._acts, **self._ended_acts}:
            self._end(user)
            self._write(user)
        self.selections += filter(None, self._pending.values())
        self.selections += self._selected.values()
        self._selected.clear()

    def _begin(self, user: str, object_id: str, now_ns: int) -> _OpenAct:
        cursor = self._cursors.get(user)
        act = _OpenAct(object_id=object_id, kind=self._kind(object_id), begin_ns=now_ns, last_ns=now_ns)
        if cursor is not None:
            act.surface = cursor.solid or cursor.surface
            act.surface_id = cursor.surface_id
        self._acts[user] = act
        return act

    def _end(self, user: str) -> None:
        act = self._acts.pop(user, None)
        if act is not None:
            self._write(user)
            self._ended_acts[user] = act

    def _open_act(self, event: SelectionEvent) -> _OpenAct | None:
        """Return the act that `event` completed. A second event on the same object begins another act."""
        act = self._acts.get(event.user)
        is_open = act is not None and act.object_id == event.object_id
        if not is_open:
            act = self._ended_acts.get(event.user)
        if act is None or act.object_id != event.object_id:
            return None
        if event.stamp_ns - act.last_ns > AFTER_S * NS_PER_S:
            return None
        if act.event is None:
            act.event = event
            return act

        # The act has an event already: a further one begins another act, if the cursor is there still.
        if not is_open:
            return None
        self._end(event.user)
        next_act = self._begin(event.user, event.object_id, act.event.stamp_ns)
        next_act.last_ns = max(next_act.last_ns, event.stamp_ns)
        next_act.event = event
        return next_act

    def _selection(self, event: SelectionEvent, act: _OpenAct | None) -> SelectionCsvRow:
        row = SelectionCsvRow(
            user=event.user,
            object_id=event.object_id,
            object_kind=event.kind or self._kind(event.object_id),
            selected_s=self._s(event.stamp_ns),
            selected_ns=event.stamp_ns,
            pointed_s=None,
            cause=event.cause,
            confidence=event.confidence,
            range_m=None,
            miss_rad=None,
        )
        if act is None:
            return row
        pointed_s = (event.stamp_ns - act.begin_ns) / NS_PER_S
        of_act = {"pointed_s": pointed_s, "range_m": act.range_m, "miss_rad": act.miss_rad}
        return row.model_copy(update=of_act)

    def _close_selection(self, event: SelectionEvent) -> None:
        row = self._selected.pop(event.object_id, None)
        if row is None:
            return
        ended_by = event.event
        ended_user = ""
        if event.event in ("selected", "deselected"):  # taken over by another person, or ended by one
            ended_by = "deselected"
            ended_user = event.user
        if event.takes_back:
            ended_by = "failed"
        kept_s = (event.stamp_ns - row.selected_ns) / NS_PER_S
        changes = {
            "ended_by": ended_by,
            "ended_s": self._s(event.stamp_ns),
            "ended_user": ended_user,
            "kept_s": kept_s,
            "bay": event.bay,
        }
        row = row.model_copy(update=changes)
        key = row.object_id, row.selected_ns
        if key in self._pending:
            self._pending[key] = row
        else:
            self.selections.append(row)

    def _write(self, user: str) -> None:
        """Collect the row of the person's last act: it cannot change any more."""
        act = self._ended_acts.pop(user, None)
        if act is None:
            return
        row = PointingAct(
            user=user,
            begin_s=self._s(act.begin_ns),
            end_s=self._s(act.last_ns),
            begin_ns=act.begin_ns,
            duration_s=(act.last_ns - act.begin_ns) / NS_PER_S,
            object_id=act.object_id,
            object_kind=act.kind,
            outcome=_outcome(act.event),
            outcome_after_s=None,
            cause="",
            confidence=None,
            progress=act.progress,
            surface=act.surface,
            surface_id=act.surface_id,
            range_m=act.range_m,
            miss_rad=act.miss_rad,
        )
        event = act.event
        if event is not None:
            outcome_after_s = (event.stamp_ns - act.begin_ns) / NS_PER_S
            of_event = {
                "object_kind": act.kind or event.kind,
                "outcome_after_s": outcome_after_s,
                "cause": event.cause,
                "confidence": event.confidence,
            }
            row = row.model_copy(update=of_event)
        self.acts.append(row)

    def _kind(self, object_id: str) -> str:
        for message in self._objects.values():
            for item in message.objects:
                if item.id == object_id:
                    return item.kind
        return ""

    def _s(self, stamp_ns: int) -> float:
        return (stamp_ns - self._began_ns) / NS_PER_S


def _outcome(event: SelectionEvent | None) -> Outcome:
    match event:
        case SelectionEvent(event="selected" | "deselected" | "refused" as outcome):
            return outcome
        case _:
            return "none"
