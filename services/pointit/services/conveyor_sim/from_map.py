"""Conveyor network of a map."""

from pointit.geometry.polyline import Polyline
from pointit.schemas import Environment
from pointit.services.conveyor_sim.config import ConveyorSimConfig
from pointit.services.conveyor_sim.network.network import Network


class UnusableMapError(Exception):
    """The map lacks what the configuration needs; the message is for users."""


def network_of(environment: Environment, config: ConveyorSimConfig) -> Network:
    """Return the belts or strips of `environment` that `config` names as a network.

    Raises:
        UnusableMapError: If one is missing or not a valid line.
    """
    surface = config.surface
    there = environment.strips if surface == "strip" else environment.belts
    lines = {line.id: line.line_m for line in there}
    wanted = config.lanes or tuple(lines)
    missing = [lane for lane in wanted if lane not in lines]
    if missing or not wanted:
        what = f"no {surface} {missing[0]!r}" if missing else f"no {surface}s"
        listed = ", ".join(lines) or "none"
        raise UnusableMapError(
            f"lanes: map {environment.name!r} has {what}, there are {listed}; "
            "set conveyor-sim.surface and conveyor-sim.lanes"
        )
    try:
        chosen = {lane: Polyline(lines[lane]) for lane in wanted}
    except ValueError as error:
        raise UnusableMapError(
            f"lanes: a {surface} of map {environment.name!r} is not a valid lane: {error}"
        ) from error
    if surface == "strip":
        return Network(chosen, longest_m=config.longest_fed_m, surface=surface)
    bays = {bay.id: bay.belt for bay in environment.bays}
    return Network(chosen, environment.links, bays, longest_m=config.longest_fed_m)
