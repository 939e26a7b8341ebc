"""A clock that can be set: of all Python processes of a machine, while they run."""

import mmap
import os
import struct
from collections.abc import Mapping
from pathlib import Path

FAKED = '''\
"""Has this process go by the clock of its machine, which a test sets."""
import mmap, os, socket, struct, time

with open(os.environ["FAKED_CLOCK"], "rb") as file:
    offset = mmap.mmap(file.fileno(), 8, access=mmap.ACCESS_READ)
wall_ns = time.time_ns
time.time_ns = lambda: wall_ns() + struct.unpack("q", offset[:])[0]
time.time = lambda: time.time_ns() / 1e9
if os.environ.get("FAKED_HOST"):
    socket.gethostname = lambda: os.environ["FAKED_HOST"]
'''


class MachineClock:
    """The wall's time and an offset, which is in a file that all processes of the machine have mapped."""

    def __init__(self, folder: Path, host: str = "") -> None:
        """Begin right; `host` is how the machine is called, else as this one."""
        folder.mkdir()
        (folder / "sitecustomize.py").write_text(FAKED)
        self._folder = folder
        self._host = host
        self._path = folder / "offset"
        self._path.write_bytes(bytes(8))
        with self._path.open("r+b") as file:
            self._offset = mmap.mmap(file.fileno(), 8)
        self.ahead_s = 0.0
        """Lead of this machine's own clock."""

    def set(self, ahead_s: float) -> None:
        self.ahead_s = ahead_s
        self._offset[:] = struct.pack("q", round(ahead_s * 1e9))

    @property
    def environment(self) -> Mapping[str, str]:
        paths = [str(self._folder), os.environ.get("PYTHONPATH", "")]
        return {
            "PYTHONPATH": os.pathsep.join(path for path in paths if path),
            "FAKED_CLOCK": str(self._path),
            "FAKED_HOST": self._host,
        }
