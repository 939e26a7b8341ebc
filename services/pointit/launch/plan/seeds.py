"""Seeds of the parts of a run, all derived from one."""

import zlib

import numpy as np


def seed_of(seed: int, part: str) -> int:
    """Return the seed of `part`, an instance such as `conveyor-sim` or `imu-bridge.user1`.

    The streams of different parts are independent (numpy's `SeedSequence`) and do not change when other
    parts are added or removed.
    """
    return int(np.random.SeedSequence([seed, zlib.crc32(part.encode())]).generate_state(1)[0])
