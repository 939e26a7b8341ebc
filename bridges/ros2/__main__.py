"""Run the bridge on its own: `python -m pointit.bridges.ros2 --help`."""

from pointit.bridges.ros2.service import SERVICE
from pointit.runtime.service.process import main

main(SERVICE)
