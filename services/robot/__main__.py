"""Run the service on its own: `python -m pointit.services.robot --help`."""

from pointit.runtime.service.process import main
from pointit.services.robot.service import SERVICE

main(SERVICE)
