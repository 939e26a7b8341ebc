"""Reading Zenoh's log never holds Zenoh up, however much it writes."""

import os
import threading

from pointit.runtime.router.router_log import MOST_LINES, _read

MARK = b"unauthorized"


def read(lines: list[bytes]) -> list[str]:
    """Return the lines accepted of `lines`, which arrive at once."""
    source, sink = os.pipe()
    taken: list[str] = []
    thread = threading.Thread(target=_read, args=(source, taken.append, (MARK,)))
    thread.start()
    with os.fdopen(sink, "wb") as pipe:
        pipe.write(b"".join(line + b"\n" for line in lines))
    thread.join(60)
    assert not thread.is_alive()
    return taken


def test_every_line_is_taken_where_there_are_few() -> None:
    assert read([b"one", b"two \xff", b""]) == ["one", "two \N{REPLACEMENT CHARACTER}", ""]


def test_of_too_many_lines_those_with_a_mark_are_taken_and_others_are_left_out() -> None:
    count = 20 * MOST_LINES
    taken = read([*[b"x"] * count, b"anna is unauthorized", *[b"x"] * count])
    assert "anna is unauthorized" in taken
    assert len(taken) < count
