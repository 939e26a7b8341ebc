"""From a scenario to running services. It knows neither the command line nor the terminal."""
