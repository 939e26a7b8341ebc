"""Wrists keep their rate, and leave out what they could not put in time."""

import asyncio
import time

from pointit.schemas import ImuSample
from pointit_lab.loadtest.wrist import Wrist, drive_wrists


class Sent:
    """Takes samples; the first takes long."""

    def __init__(self, stall_s: float = 0.0) -> None:
        self.samples: list[ImuSample] = []
        self._stall_s = stall_s

    def put(self, message: ImuSample) -> None:
        if not self.samples:
            time.sleep(self._stall_s)
        self.samples.append(message)

    def close(self) -> None: ...
    def close_nowait(self) -> None: ...


async def test_each_wrist_puts_what_its_rate_says_and_never_more() -> None:
    sent = [Sent(), Sent(), Sent()]
    began_s = time.monotonic()
    await drive_wrists([Wrist(one) for one in sent], 50.0, 1.0)
    assert time.monotonic() - began_s >= 0.95
    assert all(10 < len(one.samples) <= 50 for one in sent), "fewer on a busy machine"
    assert [sample.seq for sample in sent[0].samples] == list(range(1, len(sent[0].samples) + 1))


async def test_what_is_late_is_left_out_and_not_put_in_a_burst() -> None:
    sent = Sent(stall_s=0.5)
    await drive_wrists([Wrist(sent)], 100.0, 1.0)
    assert len(sent.samples) <= 52


async def test_without_wrists_it_only_lasts() -> None:
    began_s = time.monotonic()
    await drive_wrists([], 100.0, 0.1)
    assert time.monotonic() - began_s >= 0.09
    await asyncio.sleep(0)
