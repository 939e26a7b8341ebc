"""Run the service on its own: `python -m pointit.services.user_sim --help`."""

from pointit.runtime.service.process import main
from pointit.services.user_sim.service import SERVICE

main(SERVICE)
