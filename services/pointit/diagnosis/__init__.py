"""What is wrong with a running site and what to do, from what its services say of themselves; pure."""
