"""The lab's lamps, the room that has them alone, and parameters of procedures."""

from pointit.schemas import Environment, Lamp
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation_config import TrustConfig

LAMPS = (
    Lamp(id="led_0", position_m=(3.572, -2.946, 2.08)),
    Lamp(id="led_1", position_m=(1.699, -2.609, 0.85)),
    Lamp(id="led_2", position_m=(0.762, -1.031, 0.15)),
)
PLACES = {lamp.id: lamp.position_m for lamp in LAMPS}
ROOM = Environment(stamp_ns=0, name="lab", lamps=LAMPS)
UNLIMITED = TrustConfig().model_copy(update={"max_position_sigma_m": 1e6, "max_yaw_sigma_deg": 1e6})


def config(**fields: object) -> LocalizerConfig:
    """Return the parameters `fields`; lamps in the given order and holds that begin at once unless stated."""
    return LocalizerConfig.model_validate({"order": "given", "steady_degps": 0.0, **fields})
