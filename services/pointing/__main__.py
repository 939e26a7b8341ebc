"""Run the service on its own: `python -m pointit.services.pointing --help`."""

from pointit.runtime.service.process import main
from pointit.services.pointing.service import SERVICE

main(SERVICE)
