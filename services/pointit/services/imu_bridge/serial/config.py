"""Parameters of a wrist on a serial port."""

from typing import Literal

from pydantic import Field

from pointit.runtime.config.config import Config
from pointit.services.imu_bridge.serial.fifth_number import Fifth
from pointit.services.imu_bridge.streams.json_content import Order

Format = Literal["text", "witmotion", "bno085", "ximu3"]


class SerialConfig(Config):
    """A device on a serial port, or on a Bluetooth port that looks like one."""

    port: str = Field(
        default="",
        description="path or name of the port, or empty for the only one that answers; "
        "/dev/serial/by-id/... survives plugging in again",
    )
    format: Literal["auto", "text", "witmotion", "bno085", "ximu3"] = Field(
        default="auto",
        description="format of the data: lines of text, WitMotion's, UART-RVC of a BNO085, or x-IMU3's; "
        "auto: recognized",
    )
    baud: int = Field(
        default=0,
        ge=0,
        le=4_000_000,
        description="bits per second; 0: found by trying, from 115200 and 9600 on",
    )
    order: Order = Field(default="wxyz", description="order of the quaternion's numbers in a line of text")
    fifth: Fifth = Field(
        default="auto",
        description="meaning of a fifth number in a line of text: a number of a sensor, a leading time in µs "
        "or a trailing accuracy; auto: before the quaternion a sensor if it returns, else a time; behind it "
        "an accuracy, unless it comes round and round",
    )
    sensor: str = Field(
        default="",
        description="name, number or address of the sensor whose lines of text are used; the first if empty",
    )
    configure: bool = Field(
        default=True,
        description="switch a WitMotion device that sends no quaternions to them, at 100 Hz (50 Hz at 9600 "
        "baud) and without magnetometer, until its power is off",
    )
    timeout_s: float = Field(
        default=3.0,
        gt=0,
        le=60,
        description="time without readable data after which a connected device is a warning, s",
    )
