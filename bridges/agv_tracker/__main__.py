"""Run the bridge on its own: `python -m pointit.bridges.agv_tracker --help`."""

from pointit.bridges.agv_tracker.service import SERVICE
from pointit.runtime.service.process import main

main(SERVICE)
