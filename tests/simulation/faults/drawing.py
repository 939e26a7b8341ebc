"""The plan of the site and its faults, drawn from a seed.

All faults are drawn before the run, so that any of them can be left out. Half of all seeds have exactly one
fault and a dense operator: what they find needs no shrinking.
"""

from collections.abc import Sequence
from random import Random

from tests.simulation.faults.fault import Fault
from tests.simulation.world.devices import DEVICES
from tests.simulation.world.room import PEOPLE, THINGS
from tests.simulation.world.world import Plan

FIRST_FAULT_S = 5.0
FAULTS_S = 20.0
CALM_S = 40.0
DENSE_PERIOD_S = 0.15
DURATIONS_S = (0.3, 1.0, 2.5, 3.5, 4.5, 8.0, 16.0)
BLOCKS_S = (0.3, 1.0, 2.5, 5.0)
RESTARTS_S = (0.3, 1.0, 2.0, 4.0, 8.0)

KILL_POINTS = {
    "after selection/events": ("selector",),
    "after selection/outcomes": ("selector",),
    "after selection": ("selector",),
    "after acts/{carrier}": ("reactions", "home-assistant", "function"),
    "after things/{carrier}": ("reactions", "home-assistant", "function"),
    "after users/{user}/claim": ("selector.", "pui."),
    "commit": ("selector", "keeper"),
    "committed": ("selector", "keeper"),
    "file": ("keeper", "localizer.", "pui"),
    "rename": ("keeper", "localizer.", "pui"),
    "reply": ("selector", "pui", "led-driver", "supervisor."),
    "put": (),
    "after put": (),
}
"""Points at which a process is killed, and names of those that pass it. One that ends with a dot begins a
name. No names: any process."""
PASSES = (1.0, 1.0, 1.0, 2.0, 3.0, 5.0, 10.0, 30.0)
"""Number of times that a process passes a point until it is killed there."""
KINDS = (
    "kill", "kill", "kill at", "kill at", "kill at", "restart", "stop", "block", "cut", "router", "slow link",
    "bad link", "clock", "coarse clock", "drift", "full disk", "slow disk", "leave", "device", "by hand",
    "burst",
)  # fmt: skip
HOST_NUMBERS = {
    "slow link": (0.05, 0.3, 1.0, 4.0, 7.0),
    "bad link": (0.01, 0.1, 0.4),
    "clock": (-30.0, -12.0, -3.0, -0.4, 0.4, 3.0, 12.0, 30.0),
    "drift": (-500.0, 500.0, 5000.0),
    "slow disk": (0.05, 0.4, 1.5),
    "full disk": (0.0,),
    "coarse clock": (0.0,),
}
"""Quantities of the faults of a machine or its link: delay, s, share of lost messages, offset, s, drift, ppm,
duration of a write, s."""
CLOCK_KINDS = ("clock", "drift")
IMPORTANT_UNITS = ("selector", "site", "reactions", "home-assistant", "function", "keeper")
IMPORTANT_SHARE = 0.6


def draw_plan(seed: int) -> Plan:
    """Return the plan of a seed."""
    random = Random(f"{seed} plan")
    return Plan(
        seed=seed,
        people=random.choice((1, 1, 1, 1, 2, 2, 3, 5)),
        layout=random.choice(("one", "persons", "persons", "each")),
        method=random.choice(("gauge", "estimate", "hold")),
        rate_hz=8.0,
        has_shard=random.random() < 0.3,
        faults_s=FAULTS_S,
        calm_s=CALM_S,
        home_latency_s=random.choice((0.03, 0.3, 1.5)),
        operator_period_s=DENSE_PERIOD_S if has_one_fault(seed) else random.choice((0.15, 0.4, 1.0)),
        fail_share=random.choice((0.0, 0.05, 0.2)),
        late_share=random.choice((0.0, 0.0, 0.05)),
        by_hand_period_s=random.choice((0.0, 3.0)),
    )


def has_one_fault(seed: int) -> bool:
    """Return True if a seed has exactly one fault."""
    return seed % 2 == 0


def draw_faults(plan: Plan, units: Sequence[str], hosts: Sequence[str]) -> list[Fault]:
    """Return the faults of a seed, in order. It has a few kinds only, so that these meet more often."""
    random = Random(f"{plan.seed} faults")
    if has_one_fault(plan.seed):
        kinds = [random.choice(KINDS)]
        count = 1
    else:
        kinds = random.sample(KINDS, random.choice((1, 2, 3, 5, 8)))
        count = random.choice((2, 3, 6, 10, 16))
    targets = _Targets(random, plan, units, hosts)
    faults: list[Fault] = []
    for _ in range(count):
        at_s = round(random.uniform(FIRST_FAULT_S, FIRST_FAULT_S + plan.faults_s), 3)
        faults.append(_draw_fault(targets, at_s, random.choice(kinds)))
    return sorted(faults, key=lambda fault: fault.at_s)


class _Targets:
    """Targets of faults, drawn at random."""

    def __init__(self, random: Random, plan: Plan, units: Sequence[str], hosts: Sequence[str]) -> None:
        self.random = random
        self.people = PEOPLE[: plan.people]
        self.hosts = hosts
        self._units = [name for name in units if name != "operator"]
        self._important = [name for name in self._units if name in IMPORTANT_UNITS]

    def unit(self) -> str:
        """Return a unit, more often one that selections depend on."""
        is_important = self.random.random() < IMPORTANT_SHARE
        return self.random.choice(self._important if is_important else self._units)

    def unit_that_passes(self, point: str) -> str:
        """Return a unit that passes a kill point."""
        names = KILL_POINTS[point]
        units: list[str] = []
        for unit in self._units:
            if unit in names or any(name.endswith(".") and unit.startswith(name) for name in names):
                units.append(unit)
        if "site" in self._units and any(not name.endswith(".") for name in names):
            units.append("site")
        return self.random.choice(units) if units else self.unit()

    def device(self) -> str:
        """Return a carrier and its thing."""
        carrier, thing, _kind = self.random.choice(DEVICES)
        return f"{carrier}/{thing}"


def _draw_fault(targets: _Targets, at_s: float, kind: str) -> Fault:
    random = targets.random
    duration_s = random.choice(DURATIONS_S)
    if kind in HOST_NUMBERS:
        number = random.choice(HOST_NUMBERS[kind])
        return Fault(at_s, kind, random.choice(list(targets.hosts)), number, duration_s)
    if kind in ("leave", "device", "by hand", "burst"):
        return _draw_life(targets, at_s, kind, duration_s)
    match kind:
        case "kill" | "restart":
            return Fault(at_s, kind, targets.unit(), random.choice(RESTARTS_S))
        case "kill at":
            point = random.choice(list(KILL_POINTS))
            unit = targets.unit_that_passes(point)
            return Fault(at_s, kind, unit, random.choice(RESTARTS_S), random.choice(PASSES), point)
        case "stop":
            return Fault(at_s, kind, targets.unit(), duration_s=duration_s)
        case "block":
            return Fault(at_s, kind, targets.unit(), duration_s=random.choice(BLOCKS_S))
        case "cut":
            host = random.choice([host for host in targets.hosts if host != "hub"])
            return Fault(at_s, kind, host, duration_s=duration_s)
        case _:
            return Fault(at_s, kind, "all", duration_s=duration_s)


def _draw_life(targets: _Targets, at_s: float, kind: str, duration_s: float) -> Fault:
    """Return a fault of people or things."""
    random = targets.random
    match kind:
        case "leave":
            detail = random.choice(("", "killed"))
            return Fault(
                at_s, kind, random.choice(targets.people), random.choice((1.0, 5.0, 40.0)), 0.0, detail
            )
        case "device":
            detail = random.choice(("fails", "stuck", "slow", "slow"))
            latency_s = random.choice((0.5, 2.0, 4.5, 5.5, 9.0))
            return Fault(at_s, kind, targets.device(), latency_s, duration_s, detail)
        case "by hand":
            return Fault(at_s, kind, random.choice(("home-assistant/heater", "home-assistant/washers")))
        case _:
            detail = random.choice(("set", "undo", "both"))
            return Fault(at_s, kind, random.choice(THINGS), random.choice((3.0, 12.0, 60.0)), 0.0, detail)
