"""Run the service on its own: `python -m pointit.services.pui --help`."""

from pointit.runtime.service.process import main
from pointit.services.pui.service import SERVICE

main(SERVICE)
