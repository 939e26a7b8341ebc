"""Run the service on its own: `python -m pointit.services.imu_bridge --help`."""

from pointit.runtime.service.process import main
from pointit.services.imu_bridge.service import SERVICE

main(SERVICE)
