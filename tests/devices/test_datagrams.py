"""Wrists that send datagrams, up to a selection in scenario_3.

OSC comes from python-osc. Of the formats of `udp` there is no independent sender here.
"""

import json
import socket

from pythonosc.osc_message_builder import build_msg
from pythonosc.udp_client import UDPClient

from pointit.geometry.rotation import Quaternion
from tests.devices.red_segments import first_selected
from tests.support.buses import free_udp_port


async def test_person_with_an_osc_app_selects_a_red_segment_of_scenario_3() -> None:
    port = free_udp_port()
    with UDPClient("127.0.0.1", port) as client:

        def turn(orientation_xyzw: Quaternion) -> None:
            x, y, z, w = orientation_xyzw
            client.send(build_msg("/gyrosc/quat", [w, x, y, z]))

        event = await first_selected(f"osc:{port}", {}, turn)
    assert event.user == "user1"


async def test_person_with_a_phone_that_sends_json_selects_a_red_segment_of_scenario_3() -> None:
    port = free_udp_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as phone:

        def turn(orientation_xyzw: Quaternion) -> None:
            content = {"type": "android.sensor.game_rotation_vector", "values": orientation_xyzw}
            phone.sendto(json.dumps(content).encode(), ("127.0.0.1", port))

        event = await first_selected(f"udp:{port}", {}, turn)
    assert event.user == "user1"
