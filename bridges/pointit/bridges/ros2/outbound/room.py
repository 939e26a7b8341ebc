"""Output of lights, static frames, time, health."""

from typing import Any

import numpy as np

from pointit.bridges.ros2.outbound import values
from pointit.bridges.ros2.outbound.person import transforms
from pointit.bridges.ros2.routing.route_types import ConversionContext, Converted
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import ClockTick, Environment, Health, LampColor, StripsFrame

MAX_FRAMES = 1000
"""Maximum number of static frames of a map; a larger tf tree is useless."""
MAX_VALUES = 64
"""Maximum number of values in one service's diagnostics."""

OK, WARN = 0, 1
"""Levels of diagnostic_msgs/DiagnosticStatus."""


def led_strips(frame: StripsFrame, context: ConversionContext) -> Converted:
    """Return all pixels, red green blue; a strip's id is the number at the end of ours."""
    types = context.state.types
    strips = [
        types.make(
            "led_strip_msgs/msg/LedStrip",
            id=context.state.channels.number(strip.id),
            data=np.frombuffer(strip.rgb, dtype=np.uint8),
        )
        for strip in frame.strips
    ]
    return (types.make("led_strip_msgs/msg/LedStrips", strips=strips),)


def lamp_color(lamp: LampColor, context: ConversionContext) -> Converted:
    """Return the colour of a lamp; black is off."""
    return (values.color(context.state.types, lamp.color),)


def static_frames(room: Environment, context: ConversionContext) -> Converted:
    """Return lamps and the starts of belts and strips, x along them, all in one message."""
    children: list[tuple[str, Vec3, rotation.Quaternion]] = [
        (f"lamp/{lamp.id}", lamp.position_m, rotation.IDENTITY) for lamp in room.lamps
    ]
    for (kind, name), line in context.state.lines.items():
        way = line.tangent_at(0.0)
        turned = rotation.from_azimuth_elevation(vector.azimuth(way), vector.elevation(way))
        children.append((values.text(f"{kind}/{name}"), line.point_at(0.0), turned))
    return (transforms(context, children[:MAX_FRAMES]),)


def clock(tick: ClockTick, context: ConversionContext) -> Converted:
    """Return the site's time while it is simulated; nothing for wall time."""
    if tick.sim_ns == tick.stamp_ns and tick.speed == 1.0:
        return ()
    types = context.state.types
    now_ns = context.stamp_ns if context.is_again else tick.sim_ns
    return (types.make("rosgraph_msgs/msg/Clock", clock=values.time(types, now_ns)),)


def diagnostics(health: Health, context: ConversionContext) -> Converted:
    """Return one service's health."""
    types = context.state.types

    def value(key: str, text: str) -> Any:
        return types.make("diagnostic_msgs/msg/KeyValue", key=values.text(key), value=values.text(text))

    pairs = [value(key, text) for key, text in _figures(health)[:MAX_VALUES]]
    is_well = health.status == "ok" and not health.warnings
    status = types.make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=OK if is_well else WARN,
        name=values.text(f"pointit: {health.instance}"),
        message=values.text("; ".join(health.warnings) or health.status),
        hardware_id=values.text(health.host),
        values=pairs,
    )
    made = types.make(
        "diagnostic_msgs/msg/DiagnosticArray",
        header=values.header(types, context.stamp_ns, ""),
        status=[status],
    )
    return (made,)


def _figures(health: Health) -> list[tuple[str, str]]:
    pairs = [("errors", str(health.errors)), ("uptime, s", f"{health.uptime_s:.0f}")]
    for name, spread in (("latency", health.latency), ("step", health.step)):
        if spread is not None:
            pairs.append((f"{name} p50, ms", f"{spread.p50_s * 1e3:.3f}"))
            pairs.append((f"{name} p99, ms", f"{spread.p99_s * 1e3:.3f}"))
    pairs += [(f"{figure.name} {figure.unit}".strip(), f"{figure.value:g}") for figure in health.figures]
    pairs += [(f"{key.key} {key.direction}, Hz", f"{key.rate_hz:.1f}") for key in health.keys]
    return pairs
