"""The core of PointIt in one file: without a bus, a clock, a process or a device.

The orientation of an arm becomes a ray, the ray a cursor on a strip of light, the cursor a selection, and all
of them light. Each object below is what one service wraps, and its file is the next one to read:

    Pointer          services/pointing/pointer.py            orientation -> ray in the person's frame, {H}
    PersonCursor     services/pui/cursor.py                  ray -> cursor in the room's frame, {W}
    SelectionEngine  services/selector/selection_engine.py   cursors -> hover, claims and owners
    LightState       services/led_driver/light_state.py      cursor, hover and owner -> pixels

Run it by `python examples/core.py`. It prints the strip twice a second of its own time, which passes at once.
"""

from collections.abc import Iterator

from pointit.geometry import rotation
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    BodyMeasures,
    Environment,
    Hover,
    ImuSample,
    Selection,
    SelectionEvent,
    Strip,
    StripsFrame,
    TrackedObject,
    TrackedObjects,
    UserPose,
)
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.light_state import LightState
from pointit.services.pointing.pointer import Pointer
from pointit.services.pui.cursor import PersonCursor
from pointit.services.pui.surfaces import Surfaces
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.selection_engine import SelectionEngine
from pointit.sim.aim import Stance

USER = "anna"
ROOM = Environment(
    stamp_ns=0,
    name="one strip",
    strips=(Strip(id="strip", line_m=((3.0, 1.5, 1.0), (3.0, -1.5, 1.0)), pixels=60),),
)
PACKAGE_M: Vec3 = (3.0, -0.5, 1.0)
"""Position of the package in the room, {W}. It is 2 m from the strip's beginning."""
RATE_HZ = 50
DURATION_S = 3
STEP_NS = NS_PER_S // RATE_HZ
START_NS = 1_700_000_000 * NS_PER_S


def package(now_ns: int) -> TrackedObjects:
    """Return what a tracker publishes: one package that lies on the strip."""
    item = TrackedObject(
        id="p1",
        kind="red",
        position_m=PACKAGE_M,
        length_m=0.3,
        surface="strip",
        surface_id="strip",
        surface_position_m=2.0,
    )
    return TrackedObjects(stamp_ns=now_ns, objects=(item,))


def samples() -> Iterator[ImuSample]:
    """Yield the samples of a wrist that moves along the strip for a second, and stays on the package."""
    stance = Stance(BodyMeasures())
    for number in range(DURATION_S * RATE_HZ):
        share = min(number / RATE_HZ, 1.0)
        x_m, y_m, z_m = PACKAGE_M
        point_m = (x_m, 1.2 + share * (y_m - 1.2), z_m)
        azimuth_rad, elevation_rad = stance.aim_at(point_m)
        arm = rotation.from_azimuth_elevation(azimuth_rad, elevation_rad)
        yield ImuSample(stamp_ns=START_NS + number * STEP_NS, seq=number, orientation_xyzw=arm)


def picture(frame: StripsFrame) -> str:
    """Return the strip as text: a letter for each pixel."""
    rgb = frame.strips[0].rgb
    pixels = [rgb[first : first + 3] for first in range(0, len(rgb), 3)]
    return "".join(letter(pixel) for pixel in pixels)


def letter(pixel: bytes) -> str:
    """Return `.` for a dark pixel, `w` for a white one, else `r`, `g` or `b` for its strongest colour."""
    if max(pixel) == 0:
        return "."
    if min(pixel) == max(pixel):
        return "w"
    return "rgb"[pixel.index(max(pixel))]


def main() -> list[SelectionEvent]:
    """Let one person select one package. Return what happened."""
    pointer = Pointer()
    cursors = PersonCursor(Surfaces(ROOM))
    cursors.set_pose(UserPose(stamp_ns=0, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0))
    selector = SelectionEngine(SelectorConfig(), record=lambda _record: None)
    selector.on_map(ROOM)
    lights = LightState(LedDriverConfig())
    lights.on_map(ROOM)

    events: list[SelectionEvent] = []
    for number, sample in enumerate(samples()):
        now_ns = sample.stamp_ns
        if number % 5 == 0:
            objects = package(now_ns)
            selector.on_objects("tracker", objects)
            lights.content.set_objects("tracker", objects, now_ns)

        # The path of a sample
        ray = pointer.ray(sample, now_ns)
        cursor = None if ray is None else cursors.cursor(ray)
        if cursor is None:
            continue
        lights.on_cursor(USER, cursor, now_ns)
        for user, message in selector.on_cursor(USER, cursor):
            if isinstance(message, Hover):
                lights.content.set_hover(user, message, now_ns)
            elif isinstance(message, Selection):
                lights.content.set_selection(message)
            elif isinstance(message, SelectionEvent):
                events.append(message)
                print(
                    f"{(now_ns - START_NS) / NS_PER_S:.2f} s  {message.user} {message.event} {message.kind}"
                )
        frame = lights.frame(now_ns)
        if frame is not None and number % 25 == 0:
            print(f"{(now_ns - START_NS) / NS_PER_S:.2f} s  {picture(frame)}")
    return events


if __name__ == "__main__":
    main()
