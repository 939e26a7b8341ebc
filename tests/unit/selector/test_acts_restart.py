"""A selector that starts again: it waits for the carriers of each thing, and tells each outcome."""

import asyncio
import os
import shutil
from pathlib import Path

import pytest

from tests.support.bench import in_virtual_time, until
from tests.unit.selector.shop import Device, shop


@pytest.mark.parametrize("reports", [True, False])
@pytest.mark.parametrize("carrier_after_s", [0.0, 0.05, 0.3])
def test_thing_with_a_carrier_is_never_cleared_without_it(*, carrier_after_s: float, reports: bool) -> None:
    """Objects, states and presence reach a selector up to a round trip after the first request."""

    @in_virtual_time
    async def main() -> None:
        lamp = Device(reports=reports)
        async with shop(lamp=lamp) as home:
            await home.set("lamp")
            assert lamp.is_on

            await home.end_selector()
            await home.kill_carrier()
            await home.start_selector()
            asking = asyncio.create_task(home.clear())
            await asyncio.sleep(carrier_after_s)
            home.start_carrier()

            assert await asking == "1 of anna's objects deselected"
            await until(lambda: not lamp.is_on)
            assert home.events[-1].carriers == ("home",)

    main()


@in_virtual_time
async def test_act_is_refused_while_it_is_not_known_whether_its_carrier_runs() -> None:
    lamp = Device(reports=False)
    async with shop(lamp=lamp) as home:
        await home.set("lamp")
        await home.end_selector()
        await home.kill_carrier()
        await home.start_selector()

        assert (await home.set("lamp")).startswith("refused: whether home runs is not known yet")
        await asyncio.sleep(2.5)
        assert await home.set("lamp") == "refused: home has ended: start it again"
        assert home.selected == ["lamp"]
        assert lamp.is_on

        await asyncio.sleep(61.0)
        assert await home.set("lamp") == "lamp deselected", "it is forgotten, so the thing has no carrier"


@in_virtual_time
async def test_outcome_that_was_committed_is_told_by_the_next_selector(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    async with shop(bell=Device()) as home:
        assert await home.set("bell") == "bell selected"
        # the files as a kill leaves them between the commit of an outcome and its publication
        shutil.copytree(os.environ["POINTIT_STATE"], tmp_path / "killed")
        monkeypatch.setenv("POINTIT_STATE", str(tmp_path / "killed"))
        await home.end_selector()
        (told,) = home.outcomes

        await home.start_selector()
        await until(lambda: len(home.outcomes) == 2)
        again = home.outcomes[1]
        assert again.is_repeated
        assert again.model_copy(update={"is_repeated": False, "seq": told.seq}) == told

        # it is told, so the one after it has nothing to tell again
        await asyncio.sleep(1.0)
        await home.end_selector()
        await home.start_selector()
        await asyncio.sleep(1.0)
        assert len(home.outcomes) == 2


@in_virtual_time
async def test_outcome_of_an_act_is_told_by_the_first_selection_of_the_next_selector(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    async with shop(bell=Device()) as home:
        await home.set("bell")
        shutil.copytree(os.environ["POINTIT_STATE"], tmp_path / "killed")
        monkeypatch.setenv("POINTIT_STATE", str(tmp_path / "killed"))
        await home.end_selector()
        told = len(home.selections)
        await home.start_selector()

        (act,) = home.selections[told].acts
        assert (act.object_id, act.user, act.status) == ("bell", "anna", "done")
