"""Run the service on its own: `python -m pointit.services.localizer --help`."""

from pointit.runtime.service.process import main
from pointit.services.localizer.service import SERVICE

main(SERVICE)
