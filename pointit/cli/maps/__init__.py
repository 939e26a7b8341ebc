"""Commands on maps: check, fetch, list, plot."""
