"""What localizations found of a person's pointing, as the prior of their next one."""
