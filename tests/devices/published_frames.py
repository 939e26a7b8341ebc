"""Frames that led-driver publishes in scenario_3, beside what a controller shows of them."""

import asyncio
from collections.abc import AsyncGenerator, Callable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager

import pytest

import pointit
from pointit.api.site import Site
from pointit.schemas import StripsFrame
from pointit.services.led_driver.guarded_output import GuardedOutput
from tests.support.bench import until

Pixels = tuple[int, ...]


class Published:
    """Frames in their order, without repetitions."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.frames: list[StripsFrame] = []
        show = GuardedOutput.show

        def note(output: GuardedOutput, frame: StripsFrame, age_s: float = 0.0) -> None:
            if self.frames[-1:] != [frame]:
                self.frames.append(frame)
            show(output, frame, age_s)

        monkeypatch.setattr(GuardedOutput, "show", note)

    def __iter__(self) -> Iterator[dict[str, list[Pixels]]]:
        """Yield the pixels of each strip of each frame."""
        for frame in self.frames:
            yield {
                strip.id: [tuple(strip.rgb[at : at + 3]) for at in range(0, len(strip.rgb), 3)]
                for strip in frame.strips
            }


@asynccontextmanager
async def scenario_3(
    outputs: Sequence[Mapping[str, object]], is_enough: Callable[[], bool]
) -> AsyncGenerator[Site]:
    """Run scenario_3 with LED outputs until `is_enough`."""
    plain = [{"gamma": 1.0, **output} for output in outputs]
    async with pointit.run("scenario_3", seed=1, settings={"led-driver.outputs": plain}) as site:
        yield site
        await until(is_enough, 20)
    await asyncio.sleep(0)


def require_shown(shown: Sequence[bytes], published: Sequence[bytes]) -> None:
    """Check that `shown` are some of `published` in their order, each several times, and dark in the end."""
    assert shown, "nothing arrived"
    dark = bytes(len(shown[0]))
    assert shown[-1] == dark
    rest = iter([dark, *published])
    now: bytes | None = next(rest)
    for number, frame in enumerate(shown[:-1]):
        while frame != now:
            now = next(rest, None)
            assert now is not None, f"frame {number} was not published, or not then"
