"""Which bay each package goes to, and what came out where."""

from collections.abc import Iterable, Mapping
from typing import Literal

from pointit.schemas import BayCount, SelectionEvent
from pointit.services.conveyor_sim.package import Package
from pointit.services.conveyor_sim.routes import Routes


class Dispatch:
    """Sends selected packages to one bay and the rest to another, and counts."""

    def __init__(self, routes: Routes, *, bay_selected: str, bay_rest: str) -> None:
        self._routes = routes
        self._bay_selected = bay_selected
        self._bay_rest = bay_rest
        self.selected: dict[str, str] = {}
        """Who has which package, as it was told last."""
        self.reset()

    def reset(self) -> None:
        """Set all counts to 0."""
        self.left = 0
        """Packages that left, at a bay or where a belt ends."""
        self.refused = 0
        self.counts: dict[tuple[str, str], tuple[int, int]] = {}
        """By bay and kind: how many came out, how many of them were selected."""

    def send(self, package: Package) -> None:
        """Give a package that has just come its bay."""
        package.user = self.selected.get(package.id, "")
        wanted = self._bay_selected if package.user else self._bay_rest
        package.bay = self._routes.best(package.piece, wanted)

    def select(
        self, owners: Mapping[str, str], packages: Iterable[Package], now_ns: int
    ) -> list[SelectionEvent]:
        """Take who has what selected by now; return what came too late for its bay, each once."""
        self.selected = dict(owners)
        events: list[SelectionEvent] = []
        for package in packages:
            user = owners.get(package.id, "")
            who, package.user = user or package.user, user
            if not package.bay:
                continue
            wanted = self._bay_selected if user else self._bay_rest
            decided = package.way[-1] if package.way else package.piece
            if package.bay == wanted or self._routes.reaches(decided, wanted):
                package.bay, package.refused = wanted, ""
            elif package.refused != wanted:
                package.refused = wanted
                self.refused += 1
                events.append(
                    _event(
                        "refused",
                        package,
                        now_ns,
                        user=who,
                        reason=f"{package.kind} {package.id} is past its last way to bay {wanted} "
                        f"and goes on to bay {package.bay}",
                    )
                )
        return events

    def leave(self, package: Package, bay: str, now_ns: int) -> SelectionEvent:
        """Count a package that came out at `bay` (empty: where a belt ends) and return what is to be told."""
        self.left += 1
        if not bay:
            return _event("left", package, now_ns, user=package.user)
        count, selected = self.counts.get((bay, package.kind), (0, 0))
        self.counts[bay, package.kind] = (count + 1, selected + bool(package.user))
        return _event("dispatched", package, now_ns, user=package.user, bay=bay)

    def bays(self) -> tuple[BayCount, ...]:
        """Return the counts as they travel."""
        return tuple(
            BayCount(bay=bay, kind=kind, count=count, selected=selected)
            for (bay, kind), (count, selected) in sorted(self.counts.items())
        )


def _event(
    event: Literal["refused", "left", "dispatched"],
    package: Package,
    now_ns: int,
    *,
    user: str = "",
    reason: str = "",
    bay: str = "",
) -> SelectionEvent:
    return SelectionEvent(
        stamp_ns=now_ns,
        event=event,
        object_id=package.id,
        kind=package.kind,
        user=user,
        reason=reason,
        bay=bay,
    )
