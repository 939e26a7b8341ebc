"""Routes of the trackers that the configuration names."""

from collections.abc import Mapping

from pointit.bridges.ros2.graph.backend import SENSOR, Qos
from pointit.bridges.ros2.routing.route_types import InboundRoute
from pointit.bridges.ros2.tracking.config import TF, TrackerConfig
from pointit.bridges.ros2.tracking.trackers import TfInput, Tracker
from pointit.bridges.ros2.tracking.transforms import TransformBuffer
from pointit.schemas.topics import OBJECTS

MAX_BYTES = 64 * 1024
"""Some 600 transforms or packages, or 100 detections; decoding them blocks the loop for 6 ms."""
TF_BYTES_HZ = 1e6
"""A tenth of the loop's time."""
RATE_HZ = 25.0
"""Rate of objects on our bus."""


def tracker_routes(configs: Mapping[str, TrackerConfig]) -> tuple[InboundRoute, ...]:
    """Return the routes to `objects/NAME` of the trackers `configs` by name, with new converters."""
    if not configs:
        return ()
    buffer = TransformBuffer()
    trackers = {name: Tracker(name, config, buffer) for name, config in configs.items()}
    tf = TfInput(buffer, {name: trackers[name] for name in configs if configs[name].type == TF})
    topics = tuple(
        InboundRoute(
            *(f"tracker {name}", config.topic, config.type.replace("/", "/msg/")),
            *(SENSOR, (OBJECTS,), trackers[name].read),
            rate_hz=RATE_HZ,
            max_bytes=MAX_BYTES,
            context=f"objects of {name}",
        )
        for name, config in configs.items()
        if config.type != TF
    )
    return (
        *topics,
        InboundRoute(
            *("trackers: tf", "/tf", "tf2_msgs/msg/TFMessage"),
            *(Qos(depth=100), (OBJECTS,), tf.moving),
            bytes_hz=TF_BYTES_HZ,
            people=tf.frames_in,
            reader=" for trackers",
            max_bytes=MAX_BYTES,
            context="frames of trackers",
        ),
        InboundRoute(
            *("trackers: tf_static", "/tf_static", "tf2_msgs/msg/TFMessage"),
            *(Qos(depth=100, latched=True), (OBJECTS,), tf.static),
            reader=" for trackers",
            max_bytes=MAX_BYTES,
            context="fixed frames of trackers",
        ),
    )
