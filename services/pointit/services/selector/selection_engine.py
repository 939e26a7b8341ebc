"""The complete selection logic: pointing in; hovers, the selection, its events and cues out."""

from collections.abc import Callable

from pointit.schemas import ButtonEvent, Claim, Cursor, Feedback, Hover, TrackedObjects
from pointit.services.selector.arbiter import Arbiter
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.hover_engine import HoverEngine, PointingEngine
from pointit.services.selector.methods.method import MakeMethod, make_method
from pointit.services.selector.outputs import Output, Record
from pointit.services.selector.ownership.ownership import Ownership


class SelectionEngine(PointingEngine, Arbiter):
    """The selection of a site: an arbiter, and the pointing of the people that no shard serves."""

    def __init__(
        self, config: SelectorConfig, record: Callable[[Record], None], make: MakeMethod = make_method
    ) -> None:
        """Create with nothing selected, no people and an empty scene. `make` makes the method of each."""
        ownership = Ownership(config)
        self._hovers = HoverEngine(config, ownership, make, ownership.reservations.extend)
        super().__init__(config, ownership, record, self._hovers.latch)

    def use(self, config: SelectorConfig) -> None:
        """Change the method or its times. Selections and reservations stay."""
        super().use(config)
        self._hovers.use(config)

    def on_shard(self, user: str) -> None:
        """Note that a shard points for `user` from now on."""
        self._hovers.forget(user)
        self.tell_method()

    def on_objects(self, tracker: str, objects: TrackedObjects) -> list[Output]:
        """Update the objects of `tracker`. What it has not listed for a while has left."""
        self._hovers.on_objects(tracker, objects)
        return self.depart(objects.stamp_ns, tracker)

    def on_cursor(self, user: str, cursor: Cursor) -> list[Output]:
        """Process a cursor of `user`."""
        now_ns = cursor.stamp_ns
        if not self._hovers.is_timely(user, now_ns):
            return []
        self.on_activity(user, now_ns)
        outputs = self._hovers.on_cursor(user, cursor)
        if outputs and not all(isinstance(output.message, Hover) for output in outputs):
            outputs = self._decide(outputs)
        return outputs + self.changed_selection(now_ns) if self._has_changed else outputs

    def on_button(self, user: str, button: ButtonEvent) -> list[Output]:
        """Process a button gesture of `user`, which confirms the hovered object if so configured."""
        return self._decide(self._hovers.on_button(user, button))

    def tick(self, now_ns: int) -> list[Output]:
        """Handle ended trackers, departed objects and expired reservations."""
        return self._hovers.forget_ended(now_ns) + super().tick(now_ns)

    def _decide(self, outputs_of_hovers: list[Output]) -> list[Output]:
        outputs: list[Output] = []
        for output in outputs_of_hovers:
            message = output.message
            if isinstance(message, Claim):
                outputs += self.claim(output.user, message, message.stamp_ns)
            elif isinstance(message, Feedback):
                outputs.append(self._publisher.cue(output.user, "refused", message.text, message.stamp_ns))
            else:
                outputs.append(output)
        return outputs
