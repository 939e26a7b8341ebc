"""The lab's lamps, and the room that has them alone."""

from pointit.schemas import Environment, Lamp

LAMPS = (
    Lamp(id="led_0", position_m=(3.572, -2.946, 2.08)),
    Lamp(id="led_1", position_m=(1.699, -2.609, 0.85)),
    Lamp(id="led_2", position_m=(0.762, -1.031, 0.15)),
)
PLACES = {lamp.id: lamp.position_m for lamp in LAMPS}
ROOM = Environment(stamp_ns=0, name="lab", lamps=LAMPS)
