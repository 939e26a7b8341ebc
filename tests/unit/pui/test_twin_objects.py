"""One thing that two trackers report is told, and things that only meet are not."""

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, TrackedObject, TrackedObjects
from pointit.services.pui.tracked_objects import DuplicateFinder, DuplicateObject

BEGIN_NS = 1000 * NS_PER_S


def thing(name: str, x_m: float, *, speed_mps: float = 0.0, sigma_m: float | None = None) -> TrackedObject:
    return TrackedObject(
        id=name,
        kind="red",
        position_m=(x_m, 0.0, 1.0),
        velocity_mps=(speed_mps, 0.0, 0.0),
        position_sigma_m=sigma_m,
    )


class Room:
    """Two trackers that report five times a second, the second one 100 ms later."""

    def __init__(self) -> None:
        self.finder = DuplicateFinder()
        self.now_ns = BEGIN_NS

    def report(
        self, camera: tuple[TrackedObject, ...], robot: tuple[TrackedObject, ...], seconds: float = 0.4
    ) -> tuple[DuplicateObject, ...]:
        for _ in range(round(seconds * 5)):
            self.finder.on_objects("camera", TrackedObjects(stamp_ns=self.now_ns, objects=camera))
            self.finder.on_objects(
                "robot", TrackedObjects(stamp_ns=self.now_ns + NS_PER_S // 10, objects=robot)
            )
            self.now_ns += NS_PER_S // 5
        return self.finder.duplicates


def test_same_id_in_two_trackers_is_reported_at_any_distance() -> None:
    (twin,) = Room().report((thing("cup", 0.0), thing("box", 1.0)), (thing("cup", 5.0),), 0.4)
    assert twin == DuplicateObject("camera", "cup", "robot", "cup")
    assert twin.sentence.startswith("the trackers camera and robot both report cup: leave it out of one")


def test_two_ids_at_one_place_are_told_after_a_while() -> None:
    room = Room()
    seen = (thing("cup", 0.0),), (thing("mug", 0.1),)
    assert room.report(*seen, 1.0) == ()
    (twin,) = room.report(*seen, 2.0)
    assert twin.sentence.startswith("cup of the tracker camera and mug of robot stay at one place")
    assert room.report((thing("cup", 0.0),), (thing("mug", 2.0),), 1.0) == ()


def test_the_stated_sigma_decides_what_one_place_is() -> None:
    assert Room().report((thing("cup", 0.0, sigma_m=0.01),), (thing("mug", 0.1, sigma_m=0.01),), 4.0) == ()
    assert Room().report((thing("cup", 0.0, sigma_m=0.2),), (thing("mug", 0.4, sigma_m=0.2),), 4.0)


def test_places_are_compared_at_one_time() -> None:
    room = Room()
    at_m = 0.0
    for _ in range(20):  # at 2 m/s, a tenth of a second is 0.2 m
        room.report((thing("cup", at_m, speed_mps=2.0),), (thing("mug", at_m + 0.2, speed_mps=2.0),), 0.2)
        at_m += 0.4
    assert len(room.finder.duplicates) == 1


def test_passing_things_and_silent_trackers_are_no_twins() -> None:
    room = Room()
    where: Vec3 = (0.0, 0.0, 0.0)
    for step in range(40):
        room.report((thing("cup", where[0]),), (thing("mug", 2.0 - 0.1 * step),), 0.2)
        assert room.finder.duplicates == ()
    room.report((thing("cup", 0.0),), (thing("cup", 0.0),), 0.4)
    for _ in range(10):
        room.now_ns += NS_PER_S
        room.finder.on_objects("camera", TrackedObjects(stamp_ns=room.now_ns, objects=(thing("cup", 0.0),)))
    assert room.finder.duplicates == ()
