"""Routers of a load test: configurations that Zenoh takes, and what crosses a link."""

import json
from pathlib import Path

import pytest

from pointit.cli.loadtest.measuring import secured_site
from pointit.cli.loadtest.network.link_contents import KIND
from pointit.cli.loadtest.network.routers import plain_configuration, router_process, secured_configuration
from pointit.runtime.errors import ConfigError
from pointit.runtime.zenoh.router.router import parse_config
from pointit.runtime.zenoh.wire_format import encoding_of
from pointit.schemas import Cursor, PointingRay


def test_a_plain_router_joins_the_one_above(tmp_path: Path) -> None:
    made = plain_configuration("tcp/127.0.0.1:7447", ["tcp/198.18.0.2:7447"])
    config = parse_config(json.dumps(made), tmp_path)
    assert json.loads(config.get_json("connect/endpoints")) == ["tcp/198.18.0.2:7447"]


def test_a_secured_router_has_the_sites_rules_at_its_own_port(tmp_path: Path) -> None:
    pytest.importorskip("cryptography")
    site, credentials = secured_site(tmp_path / "site", "lab", 7447, ["127.0.0.1", "198.18.0.6"])
    made = secured_configuration(site, ["tls/198.18.0.6:7447"], 9000)
    config = parse_config(json.dumps(made), tmp_path)
    (listen,) = json.loads(config.get_json("listen/endpoints"))
    assert listen.startswith("tls/0.0.0.0:9000#")
    (uplink,) = json.loads(config.get_json("connect/endpoints"))
    assert uplink.startswith("tls/198.18.0.6:7447#")
    assert json.loads(config.get_json("access_control/enabled")) is True
    assert credentials.folder.name == "load"


async def test_zenohd_that_is_not_installed_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ConfigError, match=r"zenohd is not in PATH; install it .*or use --router pointit"):
        async with router_process(plain_configuration("tcp/127.0.0.1:0", ()), "zenohd", tmp_path):
            pass


def test_messages_name_their_kind_in_clear() -> None:
    packet = b"\x01\x02".join(str(encoding_of(kind)).encode() for kind in (Cursor, PointingRay, Cursor))
    assert KIND.findall(packet) == [b"Cursor", b"PointingRay", b"Cursor"]
