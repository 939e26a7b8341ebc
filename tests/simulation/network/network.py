"""The network of a simulated site: a router with messages, presence and requests."""

from collections.abc import Callable

from pointit.runtime.bus.contract import AnyTopic
from pointit.schemas import Message
from tests.simulation.kernel.process import Process
from tests.simulation.kernel.timeline import Timeline
from tests.simulation.network.messages import MessageNetwork
from tests.simulation.network.presence import PresenceNetwork
from tests.simulation.network.requests import RequestNetwork
from tests.simulation.network.router import Router

PutObserver = Callable[[Process, AnyTopic, str, Message], object]
"""Called with the process, topic, name and message of each put, also of those that reach nobody."""


class Network:
    """All that processes share."""

    def __init__(self, timeline: Timeline) -> None:
        self.router = Router(timeline)
        self.messages = MessageNetwork(self.router)
        self.presence = PresenceNetwork(self.router)
        self.requests = RequestNetwork(self.router)
        self.put_observers: list[PutObserver] = []
