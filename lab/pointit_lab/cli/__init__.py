"""`pointit evaluate`: its commands, tables and progress."""
