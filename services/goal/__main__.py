"""Run the service on its own: `python -m pointit.services.goal --help`."""

from pointit.runtime.service.process import main
from pointit.services.goal.service import SERVICE

main(SERVICE)
