"""Lights on two strips of ten pixels a metre, and short words for what is shown on them."""

from typing import Any

from pointit.schemas import (
    Belt,
    Cursor,
    Environment,
    Hover,
    ReservedObject,
    SelectedObject,
    Selection,
    Strip,
    TrackedObject,
    TrackedObjects,
    UserProfile,
)
from pointit.services.led_driver.config import LedDriverConfig, StyleConfig
from pointit.services.led_driver.light_state import LightState

Color = tuple[int, int, int]
WHITE = (255, 255, 255)
RED = (200, 0, 0)
GREEN = (0, 100, 0)
BLUE = (0, 0, 90)
BLACK = (0, 0, 0)
DIM = (50, 0, 0)  # a quarter of RED
PENDING = (150, 0, 0)  # three quarters
GAP = (20, 0, 0)  # a tenth

# 10 pixels a metre: pixel k of the line has its centre at 0.05 + 0.1 k
FORTH = Strip(id="forth", line_m=((0, 0, 0), (1, 0, 0), (1, 1, 0)), pixels=20)
BACK = Strip(id="back", line_m=((0, 0, 0), (2, 0, 0)), pixels=20, direction=-1)
NOW_NS = 1_700_000_000_000_000_000


def colors(data: bytes) -> list[Color]:
    return [(data[k], data[k + 1], data[k + 2]) for k in range(0, len(data), 3)]


def item(position_m: float, length_m: float = 0.6, **more: Any) -> TrackedObject:
    values: dict[str, Any] = {"id": "p", "kind": "red", "surface": "strip", "surface_id": "forth", **more}
    return TrackedObject(
        position_m=(0.0, 0.0, 0.0), surface_position_m=position_m, length_m=length_m, **values
    )


class Stage:
    """Lights, with what is on them."""

    def __init__(
        self, *strips: Strip, belts: tuple[Belt, ...] = (), margin_m: float = 0.1, tail_s: float = 0.0
    ) -> None:
        style = StyleConfig(
            kind_colors={"red": RED},
            default_color=(8, 8, 8),
            idle_level=0.25,
            pending_level=0.75,
            gap_level=0.1,
            margin_m=margin_m,
            tail_s=tail_s,
            tail_level=0.5,
        )
        self.lights = LightState(LedDriverConfig(style=style))
        self.lights.on_map(Environment(stamp_ns=0, name="stage", strips=strips or (FORTH, BACK), belts=belts))
        self.now_ns = NOW_NS

    def put(self, *items: TrackedObject) -> "Stage":
        self.lights.content.set_objects(
            "conveyor", TrackedObjects(stamp_ns=self.now_ns, objects=items), self.now_ns
        )
        return self

    def profile(self, user: str, color: Color = WHITE, width_m: float = 0.3, **more: Any) -> "Stage":
        self.lights.content.set_profile(
            user, UserProfile(stamp_ns=0, cursor_color=color, cursor_width_m=width_m, **more)
        )
        return self

    def point(self, user: str, position_m: float, line: str = "forth", **more: Any) -> "Stage":
        values: dict[str, Any] = {"surface": "strip", **more}
        self.lights.on_cursor(
            user, Cursor(stamp_ns=self.now_ns, surface_id=line, position_m=position_m, **values), self.now_ns
        )
        return self

    def hover(self, user: str, progress: float = 0.0, **more: Any) -> "Stage":
        self.lights.content.set_hover(
            user, Hover(stamp_ns=self.now_ns, object_id="p", progress=progress, **more), self.now_ns
        )
        return self

    def select(self, owner: str = "", reserver: str = "", *, pending: bool = False) -> "Stage":
        self.lights.content.set_selection(
            Selection(
                stamp_ns=0,
                objects=(SelectedObject(id="p", user=owner, since_ns=0, is_pending=pending),)
                if owner
                else (),
                reserved=(ReservedObject(id="p", user=reserver, until_ns=1),) if reserver else (),
            )
        )
        return self

    def frame(self) -> dict[str, list[Color]]:
        frame = self.lights.frame(self.now_ns)
        assert frame is not None
        return {strip.id: colors(strip.rgb) for strip in frame.strips}

    def shown(self, strip: str = "forth") -> list[Color]:
        return self.frame()[strip]

    def lit(self, strip: str = "forth") -> list[int]:
        return [k for k, color in enumerate(self.shown(strip)) if color != BLACK]
