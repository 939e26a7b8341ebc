"""Frames of people in a bag: each is read for itself."""

from pathlib import Path

from tests.unit.conversion.test_import_bag import Said, bag, frame, imported, make, run


def test_a_frame_that_cannot_be_read_leaves_the_others_and_is_named(tmp_path: Path) -> None:
    names = ("anna", "/world"), ("ben", "optitrack"), ("eve", "world"), ("finn", "world")
    frames = [frame(1.0, f"{user}/human_footprint", parent).transforms[0] for user, parent in names]
    frames[2].transform.translation.x = 1e9
    said: list[Said] = [
        (1.0, "/tf", "tf2_msgs/msg/TFMessage", make("tf2_msgs/msg/TFMessage", transforms=frames))
    ]
    source = bag(tmp_path / "bag", said)
    assert sorted(imported(source)) == ["users/anna/pose", "users/finn/pose"]
    (tmp_path / "session.mcap").unlink()
    sentence = "the pose of ben is in the frame 'optitrack': transform it to 'world' first"
    assert sentence in " ".join(run(source).output.split())
