"""The complete selection logic, and the part of it that runs beside people."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from pointit.schemas import (
    NS_PER_S,
    ButtonEvent,
    Claim,
    Cursor,
    Feedback,
    Hover,
    Selection,
    SelectionEvent,
    ThingStates,
    TrackedObjects,
)
from pointit.services.selector.arbiter import MAX_CLAIM_AGE_NS, Arbiter
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.hover_engine import HoverEngine, PointingEngine
from pointit.services.selector.methods.pointer import MakeMethod, make_method
from pointit.services.selector.ownership import Ownership
from pointit.services.selector.selection_publisher import ACTIONS, OutgoingMessage, Record, make_cue

REPEAT_NS = NS_PER_S
"""Claims without a decision are sent again after this, ns of the wall. The arbiter ignores old ones."""

GIVE_UP_NS = 2 * MAX_CLAIM_AGE_NS
"""Claims without a decision are given up after this: the arbiter would refuse them, ns of the wall."""

NO_ARBITER = "the selector of the site cannot be reached, so nothing can be selected"


@dataclass(slots=True)
class _OpenClaim:
    """A claim to toggle an object, not decided yet."""

    user: str
    claim: Claim
    sent_ns: int
    is_decided: bool = False
    """True if its event is all that is missing."""


class ShardEngine(PointingEngine):
    """The pointing of some people of a site. The site's selector decides on what they claim."""

    def __init__(self, config: SelectorConfig, make: MakeMethod = make_method) -> None:
        """Create with nothing known of the site. `make` makes the method of each person."""
        self._ownership = Ownership(config)
        self._hovers = HoverEngine(config, self._ownership, make, self._is_reserved)
        self._renew_ns = round(config.reserve_s * NS_PER_S / 2)
        self._reserved: dict[str, Claim] = {}
        """Last claim to a reservation, by person."""
        self._open: dict[tuple[str, int], _OpenClaim] = {}
        """By person and stamp."""
        self._sent: Counter[tuple[str, str]] = Counter()
        self._knows_owners = False
        self.speed = 1.0
        """Speed of the site's time by the wall's. Ages of claims are those of the wall."""
        self.has_arbiter = False
        """True while the site's selector can be reached."""

    def use(self, config: SelectorConfig) -> None:
        """Change the method or its times."""
        self._hovers.use(config)

    def on_objects(self, tracker: str, objects: TrackedObjects) -> list[OutgoingMessage]:
        """Update the objects of `tracker`."""
        self._hovers.on_objects(tracker, objects)
        return []

    def on_states(self, carrier: str, states: ThingStates, _now_ns: int) -> list[OutgoingMessage]:
        """Note the states that a carrier reports: what is unavailable is shown as such."""
        self._ownership.acts.on_states(carrier, states)
        return []

    def on_carrier(self, carrier: str, present: bool, _now_ns: int) -> list[OutgoingMessage]:
        """Note that a carrier runs, or has ended."""
        self._ownership.acts.on_presence(carrier, present=present)
        return []

    def set_arbiter(self, *, present: bool) -> None:
        """Note that the site's selector can be reached, or not. Its next life knows no acts that are over."""
        self.has_arbiter = present
        if not present:
            self._hovers.forget_acts()

    def on_selection(self, selection: Selection) -> None:
        """Follow what the site's selector has decided."""
        self._ownership.follow(selection)
        if not self._knows_owners:
            self._knows_owners = True
            self._hovers.renew()
        if self._open:
            for selected in selection.objects:
                claim = self._open.get((selected.user, selected.since_ns))
                if claim is not None:
                    claim.is_decided = True

    def on_event(self, event: SelectionEvent) -> list[OutgoingMessage]:
        """Close the claim that `event` decides. Latch what was changed in another way, or elsewhere."""
        is_own = self._open.pop((event.user, event.stamp_ns), None) is not None
        if event.cause in ACTIONS:
            if not is_own:  # by another selector that points for them
                self._hovers.latch(event.object_id, event.user)
        elif event.cause or event.event in ("selected", "deselected"):  # else it is of the conveyor
            self._hovers.latch(event.object_id)
        return []

    def on_cursor(self, user: str, cursor: Cursor) -> list[OutgoingMessage]:
        """Process a cursor of `user`."""
        if not self._hovers.is_timely(user, cursor.stamp_ns):
            return []
        self._ownership.presences.on_activity(user, cursor.stamp_ns)
        return self._number_outputs(self._hovers.on_cursor(user, cursor), cursor.stamp_ns)

    def on_button(self, user: str, button: ButtonEvent) -> list[OutgoingMessage]:
        """Process a button gesture of `user`, which confirms the hovered object if so configured."""
        return self._number_outputs(self._hovers.on_button(user, button), button.stamp_ns)

    def tick(self, now_ns: int) -> list[OutgoingMessage]:
        """Send claims again that are not decided. Return a cue for each that never will be."""
        outputs = self._hovers.forget_ended(now_ns)
        speed = max(1.0, self.speed)
        for key, open_claim in list(self._open.items()):
            if abs(now_ns - open_claim.claim.stamp_ns) > GIVE_UP_NS * speed:
                del self._open[key]
                if not open_claim.is_decided:
                    self._hovers.forget_act(open_claim.user)
                    outputs.append(self._no_arbiter_cue(open_claim.user, now_ns))
                continue
            if open_claim.is_decided or not self.has_arbiter:
                continue
            if abs(now_ns - open_claim.sent_ns) >= REPEAT_NS * speed:
                open_claim.sent_ns = now_ns
                outputs.append(OutgoingMessage(open_claim.user, open_claim.claim))
        return outputs

    def _number_outputs(self, outputs_of_hovers: list[OutgoingMessage], now_ns: int) -> list[OutgoingMessage]:
        """Number claims and cues, and open the claims to toggle an object."""
        outputs: list[OutgoingMessage] = []
        for user, message in outputs_of_hovers:
            if isinstance(message, Feedback):
                outputs.append(self._refusal_cue(user, message.text, now_ns))
            elif not isinstance(message, Claim):
                outputs.append(OutgoingMessage(user, message))
            elif message.wish == "reserve":
                reservation = self._numbered(user, message)
                self._reserved[user] = reservation
                outputs.append(OutgoingMessage(user, reservation))
            elif not self.has_arbiter:
                self._hovers.forget_act(user)
                outputs.append(self._no_arbiter_cue(user, now_ns))
            else:
                claim = self._numbered(user, message)
                self._open[user, claim.stamp_ns] = _OpenClaim(user, claim, now_ns)
                outputs.append(OutgoingMessage(user, claim))
        return outputs

    def _is_reserved(self, user: str, object_id: str, now_ns: int) -> bool:
        """Return True if it was claimed a moment ago, or cannot be: reservations are renewed now and then."""
        if not self.has_arbiter:
            return True
        last_claim = self._reserved.get(user)
        if last_claim is None or last_claim.object_id != object_id:
            return False
        return 0 <= now_ns - last_claim.stamp_ns < self._renew_ns

    def _numbered(self, user: str, claim: Claim) -> Claim:
        self._sent["claim", user] += 1
        return claim.model_copy(update={"seq": self._sent["claim", user]})

    def _no_arbiter_cue(self, user: str, now_ns: int) -> OutgoingMessage:
        return self._refusal_cue(user, NO_ARBITER, now_ns)

    def _refusal_cue(self, user: str, text: str, now_ns: int) -> OutgoingMessage:
        self._sent["cue", user] += 1
        return OutgoingMessage(user, make_cue("refused", text, now_ns, self._sent["cue", user]))


class SelectionEngine(PointingEngine, Arbiter):
    """The selection of a site: who points at what, who wants it, and who gets it. Pure.

    Cursors and objects go in; hovers, claims, selections and events come out, as messages that a shell
    publishes. It is two halves in one object: the *pointing* of each person turns cursors into a hover and a
    claim (`HoverEngine`), and the *arbiter* turns claims into owners (`Arbiter`). A large site runs the first
    half beside its people as a shard, and only the second here, for people whom no shard serves this has
    both.

    The time of all decisions is that of the messages, so a replay decides as the site did. `examples/core.py`
    feeds it with the cursors of one person and prints the selection.
    """

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

    def on_objects(self, tracker: str, objects: TrackedObjects) -> list[OutgoingMessage]:
        """Update the objects of `tracker`. What it has not listed for a while has left."""
        self._hovers.on_objects(tracker, objects)
        return self.depart(objects.stamp_ns, tracker)

    def on_cursor(self, user: str, cursor: Cursor) -> list[OutgoingMessage]:
        """Process a cursor of `user`."""
        now_ns = cursor.stamp_ns
        if not self._hovers.is_timely(user, now_ns):
            return []
        self.on_activity(user, now_ns)
        outputs = self._hovers.on_cursor(user, cursor)
        for output in outputs:
            if not isinstance(output.message, Hover):
                outputs = self._decide_claims(outputs)
                break
        if self._has_changed:
            return outputs + self.changed_selection(now_ns)
        return outputs

    def on_button(self, user: str, button: ButtonEvent) -> list[OutgoingMessage]:
        """Process a button gesture of `user`, which confirms the hovered object if so configured."""
        return self._decide_claims(self._hovers.on_button(user, button))

    def tick(self, now_ns: int) -> list[OutgoingMessage]:
        """Handle ended trackers, departed objects and expired reservations."""
        return self._hovers.forget_ended(now_ns) + super().tick(now_ns)

    def _decide_claims(self, outputs_of_hovers: list[OutgoingMessage]) -> list[OutgoingMessage]:
        """Replace claims by what they lead to, and number cues."""
        outputs: list[OutgoingMessage] = []
        for output in outputs_of_hovers:
            message = output.message
            if isinstance(message, Claim):
                outputs += self.claim(output.user, message, message.stamp_ns)
            elif isinstance(message, Feedback):
                outputs.append(self._publisher.cue(output.user, "refused", message.text, message.stamp_ns))
            else:
                outputs.append(output)
        return outputs
