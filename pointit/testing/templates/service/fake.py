"""Harness of the service, for tests and `pointit plugin check`: its input and its expected output."""

from pointit.plugins import SelectionEvent, topics
from pointit.testing import ServiceHarness, ServiceTrial
from pointit.testing.templates.service import COUNT, SERVICE, Count

EVENT = SelectionEvent(stamp_ns=1, seq=1, event="selected", object_id="package-1", user="anna")


async def counts(trial: ServiceTrial) -> None:
    """Check that a selection is counted."""
    messages: list[Count] = []
    trial.bus.subscribe(COUNT, lambda count, _name: messages.append(count))
    trial.bus.publisher(topics.SELECTION_EVENTS).put(EVENT)
    await trial.until(lambda: bool(messages) and messages[-1].selected == 1, "a selection was not counted")


DEVICE = ServiceHarness(plugin=SERVICE, messages=((topics.SELECTION_EVENTS, EVENT),), works=counts)
