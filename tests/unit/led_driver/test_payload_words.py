"""Words by which devices of other makers tell one state, and commands of others to switches."""

import pytest

from pointit.runtime.mqtt.payload_words import is_on, is_online


@pytest.mark.parametrize(
    ("payload", "expected"),
    [
        (b"online", True),
        (b"offline", False),
        (b'{"state":"online"}', True),
        (b'{"state": "offline", "since": 1}', False),
        (b"Online", True),  # Tasmota, `tele/DEVICE/LWT`
        (b"Offline\0", False),
        (b" ONLINE\r\n", True),
        (b'"online"', True),
        (b"\xef\xbb\xbfonline", True),
        (b"connected", True),
        (
            b'{"status":"disconnected_unclean","firmware":"milight-hub","reset_reason":"External System"}',
            False,
        ),
        (b"true", True),  # Shelly
        (b"False", False),
        (b"1", True),
        (b"0", False),
        (b"2", True),  # mqtt-smarthome: with its hardware
        (b'{"time":1700000000000,"value":false,"nodeId":5}', False),  # zwave-js-ui
        (b'{"Online": true}', True),
        (b"ready", True),  # Homie, `$state`
        (b"lost", False),
        (b"Connection Lost", False),  # ESPEasy
        (b"1.0", True),
        (b'{"idx":"beca","ip":"192.168.1.7","alive":false}', False),
        (b'{"val":2,"ts":1700000000}', True),
        (b'{"state":"ON","brightness":254,"availability":"offline"}', False),
        (b'{"status":null,"online":true}', True),
        (b'{"status":{"value":"Dead","since":3}}', False),
        (b'{"state":{"state":{"state":"online"}}}', None),
        (b'{"state":"online","available":false}', False),  # the availability counts
        (b'{"status":"ready","reachable":false}', False),
        (b'{"state":"offline","connected":true}', True),  # the state of another thing
        (b'{"val":0,"online":true}', True),
        (b'{"isOnline":false,"state":1}', False),
        (b'{"is_available":"no","status":"up"}', False),
        (b'{"connectionState":"connected","status":"down"}', True),
        (b'{"state":"online","offline":true}', False),
        (b'{"disconnected":false,"value":0}', True),
        (b'{"available":null,"state":"online"}', True),
        (b'{"available":"perhaps","state":"online"}', True),
        (b'{"$state":"lost"}', False),  # Homie
        (b"sleeping", False),
        (b"alert", True),
        (b"connection_lost", False),
        (b"connection-lost", False),
        (b"Not_Connected", False),
        (b'{"LWT":"Connection_Lost"}', False),
        (b'{"connection":{"status":"not reachable"}}', False),
        (b"disconnected-clean", False),
        (b"stopped", False),  # Frigate
        (b"", None),
        (b'{"state": {}}', None),
        (b'{"state": "ON", "brightness": 254}', None),  # a lamp that is off is reachable, too
        (b"OFF", None),
        (b"1.5", None),
        (b"null", None),
        (b"\xff", None),
        (b"[" * 100_000, None),
        (None, None),
    ],
)
def test_availability_is_read_in_the_words_of_many_makers_and_nothing_else(
    payload: object, expected: object
) -> None:
    assert is_online(payload) is expected


def test_own_words_for_availability_replace_the_usual_ones() -> None:
    words = ("Level 2", "gone")
    assert [is_online(text, *words) for text in (b"level 2", b"gone", b'{"state":"GONE"}')] == [
        True,
        False,
        False,
    ]
    assert [is_online(text, *words) for text in (b"online", b"offline", b"2")] == [None, None, None]
    assert [is_online(text, "2") for text in (b"2", b"1", b"0")] == [True, None, False]
    assert [is_online(text, "1.50", "null") for text in (b"1.50", b"null", b"1")] == [True, False, None]
    whole = ('{"link":"ok"}', '{"link":"bad"}')
    assert [is_online(text, *whole) for text in (b'{"link":"ok"}', b'{"link":"bad"}\n')] == [True, False]
    assert is_online(b"other", " ") is None


@pytest.mark.parametrize(
    ("payload", "expected"),
    [
        (b"ON", True),
        (b"off", False),
        (b"true", True),
        (b"0", False),
        (b'{"state": "ON"}', True),
        (b'{"state": "OFF", "available": true}', False),
        (b'{"online": true}', None),
        (b'{"POWER": "on"}', True),  # Tasmota
        (b'{"id": 0, "on": false}', False),  # Shelly
        (b"on?", None),
        (b"toggle", None),
        (b"\xff", None),
    ],
)
def test_a_command_to_a_switch_is_read_in_the_words_of_others(payload: bytes, expected: object) -> None:
    assert is_on(payload) is expected
