"""Two nodes that publish the transform of one frame, which jumps between them then. Pure."""

from dataclasses import dataclass

from pointit.bridges.ros2.inbound import checks
from pointit.geometry import vector
from pointit.geometry.vector import Vec3

JUMP_M = 0.3
"""Distance between successive positions of a frame above which it has jumped, m."""
MIN_RETURNS = 6
"""Number of jumps back from which two nodes publish a frame."""
MAX_STEPS = 100
"""Number of transforms without a jump after which one of both has ended."""
MAX_FRAMES = 1000
"""Maximum number of frames that are followed, which bounds memory."""

Position = tuple[str, Vec3]
"""Parent of a frame, and the frame's position in it, m."""


@dataclass
class _History:
    newest: Position
    other: Position | None = None
    """Position of the frame before it jumped."""
    returns: int = 0
    """Number of jumps back to where it was before a jump."""
    steps: int = 0
    """Number of transforms since the last jump."""


class RivalPublishers:
    """Notices frames that jump to and fro, as under two publishers. One that moves does not jump back."""

    def __init__(self) -> None:
        self._frames: dict[str, _History] = {}

    def describe(self, frame: str, parent: str, position_m: Vec3) -> str:
        """Add a transform. Return a sentence with the remedy if two nodes publish the frame, else `""`."""
        position = (parent, position_m)
        history = self._frames.get(frame)
        if history is None:
            if len(self._frames) < MAX_FRAMES:
                self._frames[frame] = _History(position)
            return ""
        self._follow(history, position)
        if history.returns < MIN_RETURNS or history.other is None:
            return ""
        other_parent, _ = history.other
        parents = " and ".join(checks.named(name) for name in sorted({parent, other_parent}))
        return (
            f"two nodes publish the frame {checks.named(frame)} (in {parents}), and it jumps between them: "
            "end one of them, or have it publish another frame"
        )

    def _follow(self, history: _History, position: Position) -> None:
        previous = history.newest
        history.newest = position
        if _is_near(position, previous):
            history.steps += 1
            if history.steps > MAX_STEPS:
                history.returns = 0
            return

        # A jump: back to where the frame was before the last one, or elsewhere
        is_back = history.other is not None and _is_near(position, history.other)
        history.returns = history.returns + 1 if is_back else 0
        history.other = previous
        history.steps = 0


def _is_near(position: Position, other: Position) -> bool:
    """Return True if both have the same parent, and no jump is between them."""
    parent, position_m = position
    other_parent, other_m = other
    if parent != other_parent:
        return False
    return vector.norm(vector.subtract(position_m, other_m)) <= JUMP_M
