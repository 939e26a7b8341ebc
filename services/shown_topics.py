"""Topics for viewers."""

from typing import Any

from pointit.schemas import topics

SHOWN: tuple[topics.Topic[Any], ...] = (
    topics.PROFILE, topics.POSE, topics.LOCALIZATION, topics.CURSOR, topics.HOVER, topics.ANNOUNCED,
    topics.INTERACTION, topics.FEEDBACK, topics.GOAL, topics.STEERING, topics.UNDERSTOOD, topics.MAP,
    topics.OBJECTS, topics.ROBOT_STATE, topics.ROBOT_PLAN, topics.SELECTION, topics.SELECTION_EVENTS,
    topics.LAMP_COLOR, topics.STRIPS_FRAME, topics.CONVEYOR_STATE, topics.HEALTH, topics.DEPLOYMENT,
)  # fmt: skip
"""Everything but raw IMU samples and rays."""
