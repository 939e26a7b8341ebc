"""Run the bridge on its own: `python -m pointit.bridges.mocap --help`."""

from pointit.bridges.mocap.service import SERVICE
from pointit.runtime.service.process import main

main(SERVICE)
