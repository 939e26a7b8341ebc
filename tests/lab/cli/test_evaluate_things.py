"""`pointit evaluate things`: what is refused."""

import pytest

from pointit.runtime.errors import ConfigError
from pointit_lab.cli.things import things
from tests.support.invoked import printed


def test_an_unknown_method_is_refused_with_those_that_are_there() -> None:
    with pytest.raises(ConfigError, match=r"--method nope: there is no such method; there are .*estimate"):
        printed(things, "--method", "nope", "--jobs", "1")
