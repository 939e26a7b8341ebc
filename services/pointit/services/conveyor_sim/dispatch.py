"""Assignment of bays to packages, and the counts of departures."""

import math
from collections import deque
from collections.abc import Iterable, Mapping
from typing import Literal

from pointit.schemas import NS_PER_S, BayCount, Departure, SelectionEvent
from pointit.services.conveyor_sim.network.routes import BeltRoutes
from pointit.services.conveyor_sim.traffic.last_way import LastWay
from pointit.services.conveyor_sim.traffic.package import Package

Event = Literal["refused", "left", "dispatched"]

DEPARTURES = 50
"""Largest number of stored departures, which suffices for subscribers that were away."""


class Dispatch:
    """Sends selected packages to one bay and the rest to another, and counts them."""

    def __init__(self, routes: BeltRoutes, last_way: LastWay, *, bay_selected: str, bay_rest: str) -> None:
        self._routes = routes
        self._last_way = last_way
        self._bay_selected = bay_selected
        self._bay_rest = bay_rest
        self.selected: dict[str, str] = {}
        """User by selected package, as of the last selection."""
        self.reset()

    def reset(self) -> None:
        """Set all counts to 0."""
        self.left = 0
        """Number of packages that left, at a bay or at the end of a belt."""
        self.refused = 0
        self.counts: dict[tuple[str, str], tuple[int, int]] = {}
        """By bay (`""`: the end of a belt) and kind: number of packages that left, and of selected ones."""
        self.departures: deque[Departure] = deque(maxlen=DEPARTURES)
        """The latest packages that left and were selected, or were selected too late."""

    def assign_bay(self, package: Package) -> None:
        """Assign a new package its bay."""
        package.user = self.selected.get(package.id, "")
        wanted = self._bay_selected if package.user else self._bay_rest
        package.bay = self._routes.best(package.piece, wanted)

    def select(
        self, owners: Mapping[str, str], packages: Iterable[Package], now_ns: int
    ) -> list[SelectionEvent]:
        """Apply the selection. Return an event for each package that is now too late for its bay, once each.

        A late selection changes nothing: the package goes on to its bay for the user of that bay.
        """
        self.selected = dict(owners)
        events: list[SelectionEvent] = []
        for package in packages:
            user = owners.get(package.id, "")
            if not package.bay:
                package.user = user
                continue
            wanted = self._wanted(package, is_selected=bool(user))
            if package.bay == wanted or self._routes.reaches(package.decided, wanted):
                package.bay, package.user, package.refused = wanted, user, ""
            elif package.refused != wanted:
                package.refused = wanted
                self.refused += 1
                past = f"{package.kind} {package.id} is past its last way to bay {wanted}"
                reason = f"{past} and goes on to bay {package.bay}"
                events.append(_event("refused", package, now_ns, user=user or package.user, reason=reason))
        return events

    def until_ns(self, package: Package, now_ns: int) -> int | None:
        """Return the last time at which (de)selecting `package` changes its bay; 0: past, None: no limit."""
        wanted = self._wanted(package, is_selected=not package.user)
        if not package.bay or package.bay == wanted:
            return None
        if not self._routes.reaches(package.decided, wanted):
            return 0
        left_s = self._last_way.time_left_s(package, wanted)
        return None if left_s == math.inf else now_ns + int(left_s * NS_PER_S)

    def _wanted(self, package: Package, *, is_selected: bool) -> str:
        """Return the bay of selected packages or of the rest, or the nearest one if the map lacks it."""
        wanted = self._bay_selected if is_selected else self._bay_rest
        return wanted if self._routes.has(wanted) else self._routes.best(package.decided, wanted)

    def leave(self, package: Package, bay: str, now_ns: int) -> SelectionEvent:
        """Count a package that left at `bay` (`""`: at the end of a belt) and return its event."""
        self.left += 1
        user = package.user
        if user or package.refused:
            self.departures.append(Departure(object_id=package.id, stamp_ns=now_ns, bay=bay, user=user))
        count, selected = self.counts.get((bay, package.kind), (0, 0))
        self.counts[bay, package.kind] = (count + 1, selected + bool(user))
        return _event("dispatched" if bay else "left", package, now_ns, user=user, bay=bay)

    def bays(self) -> tuple[BayCount, ...]:
        """Return the counts as message parts."""
        return tuple(
            BayCount(bay=bay, kind=kind, count=count, selected=selected)
            for (bay, kind), (count, selected) in sorted(self.counts.items())
        )


def _event(
    event: Event, package: Package, now_ns: int, *, user: str, reason: str = "", bay: str = ""
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
