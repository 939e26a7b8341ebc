"""What an operator types: `pointit …`."""
