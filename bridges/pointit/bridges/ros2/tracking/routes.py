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
            name=f"tracker {name}",
            ros=config.topic,
            type=config.type.replace("/", "/msg/"),
            into=(OBJECTS,),
            by=trackers[name].read,
            qos=SENSOR,
            rate_hz=RATE_HZ,
            max_bytes=MAX_BYTES,
            about=f"objects of {name}",
        )
        for name, config in configs.items()
        if config.type != TF
    )
    return (
        *topics,
        InboundRoute(
            name="trackers: tf",
            ros="/tf",
            by=tf.moving,
            qos=Qos(depth=100),
            bytes_hz=TF_BYTES_HZ,
            people=tf.frames_in,
            about="frames of trackers",
            reader=" for trackers",
            type="tf2_msgs/msg/TFMessage",
            into=(OBJECTS,),
            max_bytes=MAX_BYTES,
        ),
        InboundRoute(
            name="trackers: tf_static",
            ros="/tf_static",
            by=tf.static,
            qos=Qos(depth=100, latched=True),
            about="fixed frames of trackers",
            reader=" for trackers",
            type="tf2_msgs/msg/TFMessage",
            into=(OBJECTS,),
            max_bytes=MAX_BYTES,
        ),
    )
