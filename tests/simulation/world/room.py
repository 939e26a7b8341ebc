"""The room, its people, and the scenario of a simulated site."""

PEOPLE = ("anna", "ben", "carl", "dora", "emil")
THINGS = ("screws", "nuts", "bolts", "washers", "radio", "heater", "kettle")
BUTTONS = ("nuts", "kettle")
SWITCHES = ("washers", "radio", "heater")
SHELF_LENGTH_M = 2.8
SHELF_PARTS_M = {
    "screws": (0.15, 0.55),
    "nuts": (0.85, 1.25),
    "bolts": (1.55, 1.95),
    "washers": (2.25, 2.65),
}
"""Begin and end of the part of the strip `shelf` that belongs to a thing, m."""
LAMP_THINGS = {"radio_lamp": "radio", "heater_lamp": "heater", "door": ""}
"""Thing that each lamp shows. The lamp `door` shows none."""

MAP = """
lamps:
  radio_lamp: {position: [2.2, -1.9, 1.1]}
  heater_lamp: {position: [0.0, 2.6, 1.2]}
  door: {position: [-1.6, -1.2, 0.7]}
strips:
  shelf: {line: [[2.4, 1.4, 1.25], [2.4, -1.4, 1.25]], pixels: 56}
  line: {line: [[-2.5, 3.0, 1.0], [2.5, 3.0, 1.0]], pixels: 50}
things:
  screws: {center: [2.6, 1.05, 1.4], size: [0.4, 0.4, 0.3], mode: claim, light: {strip: shelf, from: 0.15, to: 0.55}}
  nuts: {center: [2.6, 0.35, 1.4], size: [0.4, 0.4, 0.3], light: {strip: shelf, from: 0.85, to: 1.25}}
  bolts: {center: [2.6, -0.35, 1.4], size: [0.4, 0.4, 0.3], mode: claim, light: {strip: shelf, from: 1.55, to: 1.95}}
  washers: {center: [2.6, -1.05, 1.4], size: [0.4, 0.4, 0.3], mode: switch, light: {strip: shelf, from: 2.25, to: 2.65}}
  radio: {light: radio_lamp, mode: switch}
  heater: {light: heater_lamp, mode: switch}
  kettle: {center: [0.6, 2.4, 1.0], size: [0.2, 0.2, 0.3], press: true}
"""  # noqa: E501 - one thing a line, as in a map
SCENARIO = """
about: a shelf with things that react, and segments that move along a strip
places:
  - {{position_m: [0.0, 0.0, 0.0], yaw_deg: 20.0}}
  - {{position_m: [0.3, 0.9, 0.0], yaw_deg: -35.0}}
  - {{position_m: [0.3, -0.9, 0.0], yaw_deg: 80.0}}
  - {{position_m: [-0.4, 0.5, 0.0], yaw_deg: 0.0}}
  - {{position_m: [-0.4, -0.5, 0.0], yaw_deg: 10.0}}
site:
  pui: {{map: {map}, surfaces: [strip]}}
  selector: {{method: {method}}}
  led-driver: {{max_rate_hz: 4}}
  keeper: {{}}
  reactions: {{on: [sim]}}
  conveyor-sim: {{surface: strip, lanes: [line], rate_hz: 2, speed_mps: 0.2,
    feeder: {{sequence: [red, blue], interval_s: 6.0, length_m: 0.3, initial: 1}}}}
user:
  pointing: {{}}
  localizer: {{}}
  supervisor: {{press_while_pointing: confirms}}
  user-sim: {{think_s: 0.0, behaviour: select, rate_hz: {rate_hz}, lost_press_s: 0.0,
    target_kinds: [screws, nuts, bolts, washers, radio, heater, kettle, red]}}
"""
