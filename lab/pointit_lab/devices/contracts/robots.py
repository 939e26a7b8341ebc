"""Contracts of the robot drivers that come with PointIt, declared like those of any package."""

from pointit.services.robot.drivers.sim_driver import SIM
from pointit.services.robot.drivers.vda5050 import VDA5050
from pointit.testing import RobotContract
from pointit_lab.devices.agv_broker import AgvBrokerDevice


class TestSimulatedRobot(RobotContract):
    plugin = SIM
    kind = "quadrotor"
    virtual_time = True


class TestVda5050(RobotContract):
    plugin = VDA5050
    wrong_parameters = ({"broker": "hub"}, {"broker": "hub:x"}, {"version": "3.0.0"})
    shows_motion = True
    device = AgvBrokerDevice

    def parameters(self, device: AgvBrokerDevice) -> dict[str, object]:
        broker = f"{device.host}:{device.port}"
        return {"broker": broker, "manufacturer": "acme", "serial_number": "7"}

    def is_moving(self, device: AgvBrokerDevice) -> bool:
        return bool(device.agv.base)
