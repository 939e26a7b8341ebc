"""Run the service on its own: `python -m pointit.services.pointing --help`."""

from pointit.runtime.process import main
from pointit.services.pointing.service import SERVICE

main(SERVICE)
