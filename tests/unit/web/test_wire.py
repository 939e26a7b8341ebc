"""The contract with the client: what its types come from is what the models say."""

import json
import re
from pathlib import Path

import pytest
from pydantic import TypeAdapter, ValidationError

from pointit.bridges.web import wire
from pointit.schemas.topics import TOPICS
from pointit.services.shown_topics import SHOWN

CLIENT = Path(wire.__file__).with_name("client") / "wire.json"

RECEIVED: TypeAdapter[wire.Ack | wire.Ask | wire.AimAt | wire.Play | wire.Turn] = TypeAdapter(wire.Received)


@pytest.mark.skipif(not CLIENT.parent.is_dir(), reason="the client's sources are not installed")
def test_the_clients_schema_is_the_models() -> None:
    assert json.loads(CLIENT.read_text(encoding="utf-8")) == json.loads(json.dumps(wire.json_schema())), (
        "run scripts/page and commit what it writes"
    )


@pytest.mark.skipif(not CLIENT.parent.is_dir(), reason="the client's sources are not installed")
def test_the_client_takes_every_topic_that_it_is_sent() -> None:
    text = CLIENT.with_name("src").joinpath("site", "apply.ts").read_text(encoding="utf-8")
    unseen = re.search(r"type Unseen =(.*?);", text, re.DOTALL)  # tsc sees to all others
    assert unseen
    assert set(re.findall(r'"(.+?)"', unseen[1])) == {topic.key for topic in set(TOPICS) - set(SHOWN)}


@pytest.mark.parametrize(
    "text",
    [
        '{"kind":"ack","n":1}',
        '{"kind":"ack","n":9007199254740992,"latency_ms":12.5}',
        '{"kind":"ask","id":0,"deed":"press","name":"anna"}',
        '{"kind":"ask","id":0,"key":"conveyor/set_speed","query":{"speed_mps":1}}',
        '{"kind":"aim","user":"anna","at_m":[1,2.5,0]}',
        '{"kind":"play","at_s":1.5,"is_playing":false}',
        '{"kind":"play","speed":0.25,"step":-1}',
        '{"kind":"turn","q":[0,0,0,1],"t_ms":12.5}',
        '{"kind":"turn","q":[0,0,0,1],"t_ms":9e12}',
    ],
)
def test_what_pages_say_is_understood(text: str) -> None:
    assert RECEIVED.validate_json(text).kind in text


@pytest.mark.parametrize(
    "text",
    [
        "",
        "null",
        "[]",
        "{}",
        '{"kind":"hello"}',
        '{"kind":"ack","n":-1}',
        '{"kind":"ack","n":1,"latency_ms":NaN}',
        '{"kind":"ack","n":1,"latency_ms":-1}',
        '{"kind":"ack","n":1,"more":1}',
        '{"kind":"aim","user":"anna","at_m":[1,2]}',
        '{"kind":"aim","user":"anna","at_m":[1,2,1e300]}',
        '{"kind":"aim","user":"a/b","at_m":[1,2,3]}',
        '{"kind":"turn","q":[0,0,0,2],"t_ms":0}',
        '{"kind":"turn","q":[0,0,0,1],"t_ms":1e13}',
        '{"kind":"ask","id":1,"deed":"explode"}',
        '{"kind":"play","speed":16}',
        '{"kind":"play","at_s":-1}',
        '{"kind":"play","step":2}',
    ],
)
def test_what_is_none_of_it_is_not(text: str) -> None:
    with pytest.raises(ValidationError):
        RECEIVED.validate_json(text)
