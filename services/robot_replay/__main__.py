"""Run the service on its own: `python -m pointit.services.robot_replay --help`."""

from pointit.runtime.service.process import main
from pointit.services.robot_replay.service import SERVICE

main(SERVICE)
