"""What an entity of a home is: a lamp of some kind, another thing, or one with which harm can be done."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from pointit.schemas.home import HomeKind

if TYPE_CHECKING:
    from pointit.bridges.home_assistant.entities import HomeEntity

KINDS: Mapping[str, HomeKind] = {
    "light": "lamp",
    "switch": "plug",
    "input_boolean": "plug",
    "fan": "fan",
    "cover": "cover",
    "media_player": "media",
    "scene": "scene",
    "script": "scene",
    "button": "scene",
    "lock": "danger",
    "climate": "danger",
    "water_heater": "danger",
    "valve": "danger",
    "siren": "danger",
    "alarm_control_panel": "danger",
    "lawn_mower": "danger",
}
"""Kind by the domain of an entity."""
DANGEROUS_CLASSES = ("garage", "gate", "door")
"""Device classes of covers that are dangerous if somebody opens them unseen."""
WORDS: tuple[tuple[HomeKind, tuple[str, ...]], ...] = (
    ("strip", ("strip", "led-strip", "wled", "string")),
    ("ceiling", ("ceiling", "pendant", "chandelier")),
    ("spot", ("spot", "track-light")),
)
"""Kinds of lights by words of their icon or name."""


def kind_of(entity: "HomeEntity") -> HomeKind:
    """Return what an entity is: by its domain, its device class, its icon, and its name."""
    domain, _, name = entity.entity.partition(".")
    kind = KINDS.get(domain, "other")
    words = f"{name} {entity.name}".lower()
    if kind == "cover":
        is_dangerous = entity.device_class in DANGEROUS_CLASSES
        is_dangerous |= any(word in words for word in ("garage", "gate"))
        return "danger" if is_dangerous else "cover"
    if kind != "lamp":
        return kind
    for light_kind, signs in WORDS:
        if any(sign in entity.icon or sign in words for sign in signs):
            return light_kind
    return "lamp"
