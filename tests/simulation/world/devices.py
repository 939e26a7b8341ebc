"""Devices that acts switch. They outlive processes, and do what they were told."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pointit.runtime.service.carrier import Act, ActFailedError
from pointit.schemas import ThingState
from tests.simulation.kernel.process import PROCESS
from tests.simulation.kernel.timeline import Timeline

LIMIT_S = 5.0
"""Time limit of each act, s."""
LATENCY_S = 0.05
STARTED_LATENCY_S = 2.0
"""Latency above which a program tells that it has started, s."""
EFFECT_SHARE = 0.7
"""Share of the latency after which the device has switched. Its answer takes the rest."""
LATE_S = 6.0
"""Latency beyond the limit, s."""
FOR_EVER_S = 3600.0

DEVICES = (
    ("reactions", "radio", "program"),
    ("reactions", "nuts", "webhook"),
    ("home-assistant", "heater", "reporting"),
    ("home-assistant", "washers", "reporting"),
    ("function", "radio", "program"),
    ("function", "kettle", "webhook"),
    ("function", "bolts", "program"),
)
"""Carrier, thing and kind. A `program` ends with its act, a `webhook` does what was sent, and the state of a
`reporting` one is known."""


@dataclass(eq=False)
class Deed:
    """One attempt to switch a device for an act."""

    device: "Device"
    act: tuple[str, int]
    """Thing and stamp of the event, ns."""
    is_on: bool
    takes_back: bool
    began_s: float
    fails: bool = False
    is_stuck: bool = False
    latency_s: float = 0.0
    result: str = ""
    """`done`, `failed`, `cancelled`, or `""` while it goes on."""


DeedObserver = Callable[[Deed], object]


class Device:
    """A thing of the world."""

    def __init__(self, timeline: Timeline, carrier: str, thing: str, kind: str) -> None:
        self.carrier = carrier
        self.thing = thing
        self.kind = kind
        self.is_on = False
        self.usual_latency_s = LATENCY_S
        self.latency_s = LATENCY_S
        self.fails = False
        self.is_stuck = False
        self.fail_share = 0.0
        """Share of acts at which it fails."""
        self.late_share = 0.0
        """Share of acts for which it takes longer than their limit."""
        self._random = timeline.random(f"device {carrier} {thing}")
        self.deeds: list[Deed] = []
        self.on_change: list[Callable[[], object]] = []
        self.on_deed: list[DeedObserver] = []
        self.timeline = timeline

    def __str__(self) -> str:
        return f"{self.carrier}/{self.thing}"

    def become_good(self) -> None:
        """End all faults."""
        self.fails = False
        self.is_stuck = False
        self.fail_share = 0.0
        self.late_share = 0.0
        self.latency_s = self.usual_latency_s

    def switch(self, *, is_on: bool) -> None:
        """Switch it, for an act or by hand."""
        if self.is_on == is_on:
            return
        self.is_on = is_on
        self.timeline.note("device", f"{self} is {'on' if is_on else 'off'}")
        for callback in list(self.on_change):
            callback()

    def begin(self, act: Act) -> Deed:
        """Begin to do what `act` says. It has its effect even if the process dies meanwhile."""
        event = act.event
        deed = Deed(self, (act.thing, event.stamp_ns), act.on, event.takes_back, self.timeline.now_s)
        deed.fails = self.fails or self._random.random() < self.fail_share
        deed.is_stuck = self.is_stuck
        is_late = self._random.random() < self.late_share
        deed.latency_s = LATE_S if is_late else self.latency_s
        self.deeds.append(deed)
        state = "on" if act.on else "off"
        purpose = " (takes back)" if event.takes_back else ""
        self.timeline.note("deed", f"{self} {state} for {event.stamp_ns % 10**12}{purpose}")
        for observe in self.on_deed:
            observe(deed)
        if not deed.is_stuck:
            self.timeline.after(EFFECT_SHARE * deed.latency_s, self._take_effect, deed)
        return deed

    def _take_effect(self, deed: Deed) -> None:
        is_ended = deed.result == "cancelled" and self.kind == "program"
        if is_ended or deed.fails:
            return
        self.switch(is_on=deed.is_on)
        deed.result = deed.result or "done"


class SimulatedTarget:
    """The connection of a carrier to a device (a `Target`)."""

    def __init__(self, device: Device) -> None:
        self.device = device

    @property
    def state(self) -> ThingState:
        """Return the state that the carrier knows."""
        if self.device.kind != "reporting":
            return ThingState(id="", limit_s=LIMIT_S)
        state: Any = "on" if self.device.is_on else "off"
        return ThingState(id="", state=state, limit_s=LIMIT_S)

    async def carry_out(self, act: Act, /) -> None:
        """Switch the device.

        Raises:
            ActFailedError: The device failed.
        """
        device = self.device
        act.check_in_time()
        process = PROCESS.get()
        if process is not None and process.is_dead:
            await asyncio.Event().wait()  # it was killed in this very step
        deed = device.begin(act)
        if deed.latency_s > STARTED_LATENCY_S and device.kind == "program":
            act.tell_started()
        try:
            await asyncio.sleep(FOR_EVER_S if deed.is_stuck else deed.latency_s)
        except asyncio.CancelledError:
            deed.result = deed.result or "cancelled"
            raise
        if deed.fails:
            deed.result = "failed"
            raise ActFailedError("unavailable", f"{device.thing} cannot be reached: look at its plug")
