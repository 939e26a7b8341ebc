"""Which bay each package goes to, and what came out where."""

import math
from collections import deque
from collections.abc import Iterable, Mapping
from typing import Literal

from pointit.schemas import NS_PER_S, BayCount, Departure, SelectionEvent
from pointit.services.conveyor_sim.network.routes import Routes
from pointit.services.conveyor_sim.traffic.last_way import LastWay
from pointit.services.conveyor_sim.traffic.package import Package

DEPARTURES = 50
"""Departures that are kept for readers that were away; more packages are hardly selected at a time."""


class Dispatch:
    """Sends selected packages to one bay and the rest to another, and counts."""

    def __init__(self, routes: Routes, last_way: LastWay, *, bay_selected: str, bay_rest: str) -> None:
        self._routes = routes
        self._last_way = last_way
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
        self.departures: deque[Departure] = deque(maxlen=DEPARTURES)
        """The latest packages that left and were selected, or came too late for it."""

    def assign_bay(self, package: Package) -> None:
        """Give a package that has just come its bay."""
        package.user = self.selected.get(package.id, "")
        wanted = self._bay_selected if package.user else self._bay_rest
        package.bay = self._routes.best(package.piece, wanted)

    def select(
        self, owners: Mapping[str, str], packages: Iterable[Package], now_ns: int
    ) -> list[SelectionEvent]:
        """Take who has what selected by now; return what came too late for its bay, each once.

        What came too late changes nothing: the package goes on to its bay, for whom it was sent there.
        """
        self.selected = dict(owners)
        events: list[SelectionEvent] = []
        for package in packages:
            user = owners.get(package.id, "")
            if not package.bay:
                package.user = user
                continue
            wanted = self._wanted(package, is_selected=bool(user))
            if package.bay == wanted or self._routes.reaches(_decided(package), wanted):
                package.bay, package.user, package.refused = wanted, user, ""
            elif package.refused != wanted:
                package.refused = wanted
                self.refused += 1
                events.append(
                    _event(
                        "refused",
                        package,
                        now_ns,
                        user=user or package.user,
                        reason=f"{package.kind} {package.id} is past its last way to bay {wanted} "
                        f"and goes on to bay {package.bay}",
                    )
                )
        return events

    def until_ns(self, package: Package, now_ns: int) -> int | None:
        """Return until when (de)selecting `package` changes its bay; 0: too late, None: no limit."""
        wanted = self._wanted(package, is_selected=not package.user)
        if not package.bay or package.bay == wanted:
            return None
        if not self._routes.reaches(_decided(package), wanted):
            return 0
        left_s = self._last_way.time_left_s(package, wanted)
        return None if left_s == math.inf else now_ns + int(left_s * NS_PER_S)

    def _wanted(self, package: Package, *, is_selected: bool) -> str:
        """Return the bay of selected packages or of the rest; one the map does not have is the nearest."""
        wanted = self._bay_selected if is_selected else self._bay_rest
        return wanted if self._routes.has(wanted) else self._routes.best(_decided(package), wanted)

    def leave(self, package: Package, bay: str, now_ns: int) -> SelectionEvent:
        """Count a package that came out at `bay` (empty: where a belt ends) and return what is to be told."""
        self.left += 1
        if package.user or package.refused:
            self.departures.append(
                Departure(object_id=package.id, stamp_ns=now_ns, bay=bay, user=package.user)
            )
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


def _decided(package: Package) -> int:
    """Return the piece to which it is decided that `package` goes."""
    return package.way[-1] if package.way else package.piece


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
