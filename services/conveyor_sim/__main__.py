"""Run the service on its own: `python -m pointit.services.conveyor_sim --help`."""

from pointit.runtime.service.process import main
from pointit.services.conveyor_sim.service import SERVICE

main(SERVICE)
