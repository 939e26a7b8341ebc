"""Run the service on its own: `python -m pointit.services.supervisor --help`."""

from pointit.runtime.service.process import main
from pointit.services.supervisor.service import SERVICE

main(SERVICE)
