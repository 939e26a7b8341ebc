"""`pointit person pose` of a person who is not there says who is."""

from pointit.services.pointing.service import Pointing
from tests.support.cli_site import Site


async def test_setting_the_pose_of_a_person_who_is_not_there_names_who_is(site: Site) -> None:
    site.start(Pointing, "user1")
    await site.arrived("pointing.user1")
    for place in ((), ("1", "1")):
        ended = await site.pointit("person", "pose", "user9", *place)
        assert ended.code == 1
        assert "no user9 is on this site, there is user1; did you mean user1" in ended.sentence
