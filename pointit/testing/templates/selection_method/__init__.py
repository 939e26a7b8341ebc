"""Selects an object when the cursor has stayed on it for the dwell time, without a break."""

from collections.abc import Collection

from pointit.plugins import (
    NS_PER_S,
    MethodConfig,
    PointingSample,
    SelectionMethod,
    SelectionProgress,
    Surroundings,
)

LONGEST_GAP_NS = 250_000_000
"""Cursors further apart are no stay, ns."""


class Method:
    """The method of one person."""

    def __init__(self, config: MethodConfig, _surroundings: Surroundings) -> None:
        self._dwell_ns = round(config.dwell_s * NS_PER_S)
        self._object: str | None = None
        self._spent_ns = 0
        self._stamp_ns: int | None = None
        self._latched: str | None = None

    @property
    def latched(self) -> Collection[str]:
        """Return the object that fired and was not left since."""
        return () if self._latched is None else (self._latched,)

    def latch(self, object_id: str) -> None:
        """Ignore `object_id` until it is left."""
        self._latched = object_id

    def step(self, pointing: PointingSample) -> SelectionProgress:
        """Process a cursor."""
        stamp_ns = pointing.cursor.stamp_ns
        under = pointing.under
        step_ns = 0 if self._stamp_ns is None else stamp_ns - self._stamp_ns
        stays = under == self._object and 0 <= step_ns <= LONGEST_GAP_NS
        self._stamp_ns = stamp_ns
        self._object = under
        self._spent_ns = self._spent_ns + step_ns if stays else 0
        if under != self._latched:
            self._latched = None
        if under is None or under == self._latched or not pointing.acts(under):
            self._spent_ns = 0
            return SelectionProgress(under)
        if self._spent_ns < self._dwell_ns:
            return SelectionProgress(under, self._spent_ns / self._dwell_ns)
        self._latched = under
        return SelectionProgress(under, 1.0, fired=under)


METHOD = SelectionMethod(
    summary="the cursor stays on the object for the dwell time", config=MethodConfig, make=Method
)
