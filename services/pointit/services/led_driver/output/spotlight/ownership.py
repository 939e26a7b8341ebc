"""Owner of the beam: of the people who point, the one who began last, or one who is named. Pure."""

from dataclasses import dataclass

from pointit.geometry.vector import Vec3
from pointit.schemas.base import Rgb


@dataclass(frozen=True, slots=True)
class Aim:
    """A person's cursor, which the beam may follow."""

    user: str
    point_m: Vec3
    """{W}."""
    color: Rgb


class BeamOwnership:
    """Cursors of the people who may have the beam."""

    def __init__(self, user: str = "") -> None:
        """Reserve the beam for `user`. `""`: for who began to point last."""
        self._user = user
        self._aims: dict[str, Aim] = {}
        """In the order in which the people began to point."""

    def set_cursor(self, user: str, point_m: Vec3 | None, color: Rgb) -> None:
        """Set the place of `user`'s cursor. None: they point at nothing."""
        if self._user not in ("", user):
            return
        if point_m is None:
            self._aims.pop(user, None)
        else:
            self._aims[user] = Aim(user, point_m, color)

    @property
    def aim(self) -> Aim | None:
        """The cursor that the beam follows, or None if nobody points."""
        return next(reversed(self._aims.values()), None)
