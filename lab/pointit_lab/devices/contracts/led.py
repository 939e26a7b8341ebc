"""Contracts of the LED outputs that come with PointIt, declared like those of any package."""

import json
import zlib

from pointit.services.led_driver.output import adalight
from pointit.services.led_driver.output.adalight import ADALIGHT
from pointit.services.led_driver.output.artnet import ARTNET
from pointit.services.led_driver.output.ddp import DDP
from pointit.services.led_driver.output.e131 import E131
from pointit.services.led_driver.output.expander import DRAW_ALL, EXPANDER, MAGIC, SET_CHANNEL_WS2812
from pointit.services.led_driver.output.mqtt_output import MQTT
from pointit.testing import LedOutputContract, PtyDevice, UdpDevice
from pointit.testing.led import DARK, PIXELS, STRIPS, lamp_id
from pointit_lab.devices.mqtt_broker import MqttBrokerDevice, published

CRC_BYTES = 4
DDP_HEADER_BYTES = 10
PIXELS_AT = 6
"""Offset of the pixels behind `MAGIC`, bytes."""

E131_HEAD = bytes.fromhex("00100000") + b"ASC-E1.17"
E131_OPTIONS_AT = 112
E131_ENDED = 0x40
E131_SLOTS_AT = 126

ARTNET_HEAD = b"Art-Net\0\x00\x50"
ARTNET_SLOTS_AT = 18


def e131_frames(received: bytes) -> list[bytes]:
    """Return the slots of each packet of E1.31 that does not just say that the stream has ended."""
    slots: list[bytes] = []
    for part in received.split(E131_HEAD)[1:]:
        packet = E131_HEAD + part
        has_ended = packet[E131_OPTIONS_AT] & E131_ENDED
        if not has_ended:
            slots.append(packet[E131_SLOTS_AT:])
    return slots


class TestExpander(LedOutputContract):
    plugin = EXPANDER
    device = PtyDevice

    def decode(self, received: bytes) -> list[bytes]:
        drawn: list[bytes] = []
        channels: dict[int, bytes] = {}
        for part in received.split(MAGIC)[1:]:
            command = part[:-CRC_BYTES]
            check = int.from_bytes(part[-CRC_BYTES:], "little")
            if zlib.crc32(MAGIC + command) != check:
                continue
            if command[1] == SET_CHANNEL_WS2812:
                channels[command[0]] = command[PIXELS_AT:]  # red, green, blue: the board sorts them
            elif command[1] == DRAW_ALL:
                pixels = [channels[number] for number in sorted(channels)]
                drawn.append(b"".join(pixels))
        return drawn


class TestAdalight(LedOutputContract):
    plugin = ADALIGHT
    device = PtyDevice

    def decode(self, received: bytes) -> list[bytes]:
        _, *parts = received.split(adalight.MAGIC)
        header_bytes = adalight.HEADER_BYTES - len(adalight.MAGIC)
        # the contract's pixels are 0 and 255, so that they contain no magic
        frames = [part[header_bytes:] for part in parts]
        return [frame for frame in frames if len(frame) == len(DARK)]


class TestDdp(LedOutputContract):
    plugin = DDP
    wrong_parameters = ({"host": ""}, {"host": "wled.local", "port": 0})
    device = UdpDevice

    def decode(self, received: bytes) -> list[bytes]:
        frames: list[bytes] = []
        while received:
            length_field = received[DDP_HEADER_BYTES - 2 : DDP_HEADER_BYTES]
            length = int.from_bytes(length_field, "big")
            end = DDP_HEADER_BYTES + length
            frames.append(received[DDP_HEADER_BYTES:end])
            received = received[end:]
        return frames


class TestE131(LedOutputContract):
    plugin = E131
    wrong_parameters = ({"universe": 0}, {"host": "multicast"}, {"host": "multicast", "interface": "eth0"})
    device = UdpDevice

    decode = staticmethod(e131_frames)


class TestArtNet(LedOutputContract):
    plugin = ARTNET
    wrong_parameters = ({"universe": 32768},)
    device = UdpDevice

    def decode(self, received: bytes) -> list[bytes]:
        """Return the slots of each ArtDmx packet, without the one that makes their number even."""
        _, *parts = received.split(ARTNET_HEAD)
        slots = [(ARTNET_HEAD + part)[ARTNET_SLOTS_AT:] for part in parts]
        return [packet_slots[: 3 * PIXELS] for packet_slots in slots]


class TestMqttLamps(LedOutputContract):
    plugin = MQTT
    wrong_parameters = ({"broker": ""}, {"broker": "hub", "password_file": "missing"}, {"topic": "lamps/set"})
    device = MqttBrokerDevice

    def parameters(self, device: MqttBrokerDevice) -> dict[str, object]:
        broker = f"{device.host}:{device.port}"
        return {"broker": broker, "lamp_rate_hz": 100.0, "max_rate_hz": 1000.0}

    def decode(self, received: bytes) -> list[bytes]:
        """Return the colours of all lamps after each command of Zigbee2MQTT."""
        colors: dict[str, bytes] = {}
        for strip in STRIPS:
            for pixel in range(strip.pixels):
                lamp = lamp_id(strip.id, pixel)
                colors[f"zigbee2mqtt/{lamp}/set"] = bytes(3)

        pictures: list[bytes] = []
        for message in published(received):
            if message.topic not in colors:
                continue
            light = json.loads(message.payload)
            color = bytes(3)
            if light["state"] == "ON":  # the command that turns a lamp off has no colour
                color = bytes(light["color"].values())
            colors[message.topic] = color
            pictures.append(b"".join(colors.values()))
        return pictures
