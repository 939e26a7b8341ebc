"""Run the service on its own: `python -m pointit.services.listener --help`."""

from pointit.runtime.service.process import main
from pointit.services.listener.service import SERVICE

main(SERVICE)
