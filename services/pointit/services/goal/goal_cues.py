"""Cues of this service, numbered."""

from pointit.geometry.vector import Vec3
from pointit.schemas import Feedback
from pointit.schemas.cues import SIGNS, Cue


class CueFactory:
    """Makes the cues of one publisher."""

    def __init__(self) -> None:
        self._count = 0

    def make(
        self, cue: Cue, text: str, now_ns: int, place_m: Vec3 | None = None, *, sign_of: Cue | None = None
    ) -> Feedback:
        """Return the message of a cue. It looks, sounds and feels like `sign_of`, by default like `cue`.

        `place_m` is the position in {W} that the cue concerns.
        """
        self._count += 1
        sign = SIGNS[sign_of or cue]._asdict()
        return Feedback(stamp_ns=now_ns, seq=self._count, cue=cue, text=text, point_m=place_m, **sign)
