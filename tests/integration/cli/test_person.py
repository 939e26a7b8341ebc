"""`pointit person memory` with a real localizer, and without a site."""

import json
from pathlib import Path

from pointit.services.localizer.service import Localizer
from pointit.services.pointing.service import Pointing
from tests.support.cli_site import Site

ANNA = "anna"
KEPT = {
    "learnt": [
        {
            "mounting": "ble metamotion",
            "elevation_bias_rad": {"mean": 0.1, "sigma": 0.03},
            "localizations": 3,
            "learnt_ns": 1_790_000_000_000_000_000,
        }
    ]
}
TOLD = (
    "anna: ble metamotion: points 5.7° too high (1 sigma 1.7°), from 3 localizations, the last one at 2026-"
)


def keep(state: Path, user: str) -> Path:
    path = state / "users" / user / "memory.json"
    path.parent.mkdir(parents=True)
    path.write_text(json.dumps(KEPT), encoding="utf-8")
    return path


async def test_the_localizer_shows_and_erases_it(site: Site, own_state: Path) -> None:
    path, bens = keep(own_state, ANNA), keep(own_state, "ben")
    site.start(Localizer, ANNA)
    await site.arrived("localizer.anna")
    shown = await site.pointit("person", "memory", ANNA, code=0)
    assert shown.out.startswith(TOLD)
    told = json.loads((await site.pointit("person", "memory", ANNA, "--json")).out)
    assert told["from"] == "localizer"
    assert [each["mounting"] for each in told["learnt"]] == ["ble metamotion"]
    erased = await site.pointit("person", "memory", ANNA, "--erase")
    assert erased.out == "anna: it is forgotten\n"
    assert not path.exists()
    assert bens.exists()
    assert (await site.pointit("person", "memory", ANNA)).out == "anna: nothing is remembered\n"


async def test_without_a_localizer_the_file_on_this_machine_is_shown_and_erased(
    site: Site, own_state: Path
) -> None:
    path = keep(own_state, ANNA)
    shown = await site.pointit("person", "memory", ANNA, code=0)
    assert TOLD in shown.out
    erased = await site.pointit("person", "memory", ANNA, "--erase")
    assert "was deleted" in erased.out
    assert not path.exists()
    assert "no memory is stored on this machine" in (await site.pointit("person", "memory", ANNA)).out


async def test_setting_the_pose_of_a_person_who_is_not_there_names_who_is(site: Site) -> None:
    site.start(Pointing, "user1")
    await site.arrived("pointing.user1")
    for place in ((), ("1", "1")):
        ended = await site.pointit("person", "pose", "user9", *place, code=1)
        assert "no user9 is on this site, there is user1; did you mean user1" in ended.sentence
