"""Ownership of a robot: the first who wants it has it until they let go, leave, or it is stopped."""

from pointit.schemas import Steering

NOTHING = Steering(stamp_ns=0)


class RobotOwnership:
    """The one person who steers a robot, and those who want to."""

    def __init__(self, robot: str) -> None:
        self.user = ""
        """Person who steers it, or `""`."""
        self._robot = robot
        self._steerings: dict[str, Steering] = {}
        self._claims: dict[str, int] = {}
        """People who name the robot, the first one first, since when, ns; 0: they must name it again."""
        self._present: set[str] = set()

    @property
    def steering(self) -> Steering:
        """Return the wish of the person who steers it."""
        return self._steerings.get(self.user, NOTHING)

    def on_steering(self, user: str, steering: Steering) -> None:
        """Update what a person wants."""
        self._steerings[user] = steering
        if steering.robot == self._robot:
            self._claims.setdefault(user, steering.stamp_ns)
        else:
            self._claims.pop(user, None)

    def on_presence(self, user: str, *, present: bool) -> None:
        """Update whether a person is there. Who leaves has let go of the robot."""
        if present:
            self._present.add(user)
        else:
            self._present.discard(user)
            self._claims.pop(user, None)
            self._steerings.pop(user, None)

    def is_let_go(self) -> bool:
        """Return True if the person who steers it wants that no longer, or is gone."""
        return bool(self.user) and (self.user not in self._claims or self.user not in self._present)

    def candidate(self, first_ns: int, last_ns: int) -> str:
        """Return the first person who has begun to name it between these times, or `""`."""
        return next((each for each in self._wanting() if first_ns <= self._claims[each] <= last_ns), "")

    def late(self, first_ns: int, last_ns: int) -> str:
        """Return a person whose request was not granted, and is not between these times, or `""`."""
        return next((each for each in self._wanting() if not first_ns <= self._claims[each] <= last_ns), "")

    def free(self) -> None:
        """Release the robot from its user, who must choose it again."""
        if self.user in self._claims:
            self._claims[self.user] = 0
        self.user = ""

    def free_of_all(self) -> None:
        """Release the robot from its user. All requesting users must choose it again."""
        self._claims = dict.fromkeys(self._claims, 0)
        self.user = ""

    def _wanting(self) -> list[str]:
        return [user for user, since_ns in self._claims.items() if since_ns and user in self._present]
