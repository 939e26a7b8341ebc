"""Promises of a service: its input and its expected output, for tests and `pointit plugin check`."""

from pointit.plugins import SelectionEvent, topics
from pointit.testing import ServiceContract, ServiceTrial
from pointit.testing.templates.service import COUNT, SERVICE, Count

EVENT = SelectionEvent(stamp_ns=1, seq=1, event="selected", object_id="package-1", user="anna")


class ServicePromises(ServiceContract):
    """Contract of this plug-in: one test for each promise."""

    plugin = SERVICE
    messages = ((topics.SELECTION_EVENTS, EVENT),)

    async def works(self, trial: ServiceTrial) -> None:
        """Check that a selection is counted."""
        messages: list[Count] = []
        trial.bus.subscribe(COUNT, lambda count, _name: messages.append(count))
        trial.bus.publisher(topics.SELECTION_EVENTS).put(EVENT)
        await trial.until(
            lambda: bool(messages) and messages[-1].selected == 1, "a selection was not counted"
        )
