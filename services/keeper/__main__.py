"""Run the service on its own: `python -m pointit.services.keeper --help`."""

from pointit.runtime.service.process import main
from pointit.services.keeper.service import SERVICE

main(SERVICE)
