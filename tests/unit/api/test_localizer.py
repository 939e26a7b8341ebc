"""Requests to a person's localizer by the API."""

from pointit.api.site import Site
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.schemas import CancelLocalization, Done
from pointit.schemas.topics import CANCEL_LOCALIZATION


async def test_cancelling_forgets_the_bias_only_on_request(bus: MemoryBus, site: Site) -> None:
    queries: list[tuple[CancelLocalization, str]] = []

    async def cancel(query: CancelLocalization, user: str) -> Done:
        queries.append((query, user))
        return Done(message="forgotten")

    bus.serve(CANCEL_LOCALIZATION, cancel, "anna")
    await site.localizer.cancel("anna")
    assert (await site.localizer.cancel("anna", forget_bias=True)).message == "forgotten"
    assert queries == [(CancelLocalization(), "anna"), (CancelLocalization(forget_bias=True), "anna")]
