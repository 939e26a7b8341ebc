"""The examples with things, in the rooms of their maps, where a simulated person points; in virtual time."""

import asyncio
from types import ModuleType

import pytest

import pointit
from examples.things import kitchen, museum, pick_to_light
from pointit.maps.checks.check import check_map
from pointit.maps.file import read_whole_map
from tests.architecture.sources import ROOT
from tests.examples.running import running
from tests.examples.test_examples import PATIENCE_S

FOLDER = ROOT / "examples" / "things"


@pytest.mark.parametrize("example", [kitchen, museum, pick_to_light])
def test_map_of_an_example_has_no_errors(example: ModuleType) -> None:
    file, _, clouds = read_whole_map(FOLDER / f"{example.__name__.rpartition('.')[2]}.yaml", 0)
    assert [each for each in check_map(file, clouds) if each.severity == "error"] == []


def test_kitchen_switches_the_radio_and_heats_water(capsys: pytest.CaptureFixture[str]) -> None:
    async def main() -> None:
        async with pointit.run(FOLDER / "kitchen.yaml", virtual=True) as site:
            kitchen.cook(site)
            async for _ in site.pointed("radio").during(PATIENCE_S):
                break
            for thing in ("radio", "kettle"):
                await site.select.set_thing("ben", thing)
            await site.sleep(1.0)

    pointit.run_virtually(main())
    assert set(capsys.readouterr().out.splitlines()) == {
        "user1 switches the radio on",
        "ben switches the radio off",
        "ben wants hot water",
    }


def test_order_is_picked_box_by_box(capsys: pytest.CaptureFixture[str]) -> None:
    async def main() -> None:
        async with pointit.run(FOLDER / "pick_to_light.yaml", virtual=True) as site:
            picking = asyncio.create_task(pick_to_light.pick(site, ["nuts", "screws", "nuts"]))
            for box in ("bolts", "nuts", "screws", "nuts"):
                assert not picking.done()
                await site.select.set_thing("ben", box)
                await site.sleep(2.0)
            await picking

    pointit.run_virtually(main())
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("ben")]
    assert lines == [
        "ben takes bolts, wanted is nuts",
        "ben takes nuts",
        "ben takes screws",
        "ben takes nuts",
    ]


def test_exhibits_speak_once_a_minute(capsys: pytest.CaptureFixture[str]) -> None:
    async def main() -> None:
        async with pointit.run(FOLDER / "museum.yaml", virtual=True) as site, running(museum.guide(site)):
            for thing in ("coin", "statue", "coin"):
                await site.select.set_thing("ben", thing)
                await site.sleep(2.0)

    pointit.run_virtually(main())
    spoken = [line.partition(": ")[2] for line in capsys.readouterr().out.splitlines()]
    assert [spoken.count(museum.TEXTS[each]) for each in ("coin", "statue")] == [1, 1]
