"""Run the service on its own: `python -m pointit.services.selector --help`."""

from pointit.runtime.service.process import main
from pointit.services.selector.service import SERVICE

main(SERVICE)
