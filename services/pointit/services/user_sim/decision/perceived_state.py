"""State of the interaction as the person perceives it, from cues: pointing, idle, or asked to point."""

from typing import Literal

from pointit.schemas import Feedback

State = Literal["idle", "asked", "pointing"]


class PerceivedState:
    """State derived from cues. Cues before the start of the person are unknown.

    `idle`: nothing happens until they press their button. `asked`: they are to point at `target`, or to wait
    for one. `pointing`: free pointing.
    """

    def __init__(self) -> None:
        self.state: State = "idle"
        self.since_ns = 0
        """Start of the state, ns. Time at a target within pointing counts as pointing."""
        self.target = ""
        """Target while asked. `""`: it will be named, or lights up."""
        self.is_queuing = False
        """While asked: other people come first, and the lit lamp is theirs."""
        self._back: State = "idle"
        """State after being asked, if it fails or was an anchor."""

    def on_cue(self, cue: Feedback, now_ns: int) -> None:
        """Process a cue. Cues of selecting change nothing here."""
        match cue.cue:
            case "target" if cue.turn_rad is None:  # otherwise they point past everything
                self._ask(now_ns, cue.target_id)
                self.is_queuing = cue.waits
            case "started" if cue.waits:
                self._ask(now_ns, cue.target_id)
            case "started":
                self._enter("pointing", now_ns)
            case "localized":
                if self.state == "asked":
                    self._enter(self._back, now_ns)
            case "refused":
                if self.state == "asked":
                    self._enter(self._back, now_ns)
                elif self.state == "idle":  # the press failed
                    self.since_ns = now_ns
            case "stopped":
                self._enter(self._back if self.state == "asked" else "idle", now_ns)
            case _:
                pass

    def reset(self, now_ns: int) -> None:
        """Assume `idle`, as no cursor has been seen for long."""
        self._back = "idle"
        self._enter("idle", now_ns)

    def _ask(self, now_ns: int, target: str) -> None:
        if self.state != "asked":
            self._back = self.state
            if self.state != "pointing":
                self.since_ns = now_ns
        self.state = "asked"
        self.target = target
        self.is_queuing = False

    def _enter(self, state: State, now_ns: int) -> None:
        goes_on = self.state == "pointing" or (self.state == "asked" and self._back == "pointing")
        if not (goes_on and state == "pointing"):
            self.since_ns = now_ns
        self.state = state
        self.target = ""
