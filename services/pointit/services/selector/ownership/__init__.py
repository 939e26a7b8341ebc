"""Who owns, reserves and may change an object."""
