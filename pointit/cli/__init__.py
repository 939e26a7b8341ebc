"""The command line of operators: `pointit …`."""
