"""Run the bridge on its own: `python -m pointit.bridges.foxglove --help`."""

from pointit.bridges.foxglove.service import SERVICE
from pointit.runtime.service.process import main

main(SERVICE)
