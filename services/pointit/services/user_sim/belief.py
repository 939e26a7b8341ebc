"""What the person makes of what they feel and hear: whether they point, rest, or are asked to point."""

import re
from typing import Literal

from pointit.schemas import Feedback

State = Literal["idle", "asked", "pointing"]

NAMED = re.compile(r"[Pp]oint at (\S+?)[.,;]?(?:\s|$)")
"""The target in a sentence, for cues that name none by themselves."""


class Belief:
    """Follows the cues; they are events, so what came before the person did is not known.

    `idle`: nothing happens until they press their button. `asked`: they are to point at `target`, or to wait
    for one. `pointing`: they do as they like.
    """

    def __init__(self) -> None:
        self.state: State = "idle"
        self.since_ns = 0
        """When the state was entered; time at a target within pointing counts as pointing."""
        self.target = ""
        """What to point at while asked; empty: it will be told, or lights up."""
        self._back: State = "idle"
        """Where being asked leads if it fails, or was an anchor."""

    def hear(self, cue: Feedback, now_ns: int) -> None:
        """Take in a cue; those of selecting change nothing here."""
        match cue.cue:
            case "target":
                self._ask(now_ns, cue.target_id or _named(cue.text))
            case "started" if "wait" in cue.text.lower():
                self._ask(now_ns, cue.target_id)
            case "started":
                self._enter("pointing", now_ns)
            case "localized":
                if self.state == "asked":
                    self._enter(self._back, now_ns)
            case "refused":
                if self.state == "asked":
                    self._enter(self._back, now_ns)
                elif self.state == "idle":  # pressed in vain
                    self.since_ns = now_ns
            case "stopped":
                self._enter(self._back if self.state == "asked" else "idle", now_ns)
            case _:
                pass

    def see_cursor(self, now_ns: int) -> None:
        """Take in that the own cursor moves with the hand: then they point, whatever was heard."""
        if self.state == "idle":
            self._enter("pointing", now_ns)

    def doubt(self, now_ns: int) -> None:
        """Take nothing for granted any more: no cursor has been seen for long."""
        self._back = "idle"
        self._enter("idle", now_ns)

    def _ask(self, now_ns: int, target: str) -> None:
        if self.state != "asked":
            self._back = self.state
            if self.state != "pointing":
                self.since_ns = now_ns
        self.state = "asked"
        self.target = target

    def _enter(self, state: State, now_ns: int) -> None:
        if not (self.state == "asked" and state == "pointing" == self._back):
            self.since_ns = now_ns
        self.state = state
        self.target = ""


def _named(text: str) -> str:
    found = NAMED.search(text)
    return found.group(1) if found else ""
