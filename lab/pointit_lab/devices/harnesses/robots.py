"""Harnesses of the robot drivers that come with PointIt, declared like those of any package."""

from pointit.services.robot.drivers.sim_driver import SIM
from pointit.services.robot.drivers.vda5050 import VDA5050
from pointit.testing import RobotHarness
from pointit_lab.devices.agv_broker import AgvBrokerDevice

SIM_HARNESS = RobotHarness(plugin=SIM, kind="quadrotor", virtual_time=True)
VDA5050_HARNESS = RobotHarness(
    plugin=VDA5050,
    device=AgvBrokerDevice,
    parameters=lambda device: {
        "broker": f"{device.host}:{device.port}",
        "manufacturer": "acme",
        "serial_number": "7",
    },
    wrong_parameters=({"broker": "hub"}, {"broker": "hub:x"}, {"version": "3.0.0"}),
    is_moving=lambda device: bool(device.agv.base),
)
