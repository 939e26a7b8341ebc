"""Run the service on its own: `python -m pointit.services.recorder --help`."""

from pointit.runtime.service.process import main
from pointit.services.recorder.service import SERVICE

main(SERVICE)
