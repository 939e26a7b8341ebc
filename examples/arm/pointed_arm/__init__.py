"""An arm that takes what one points at, and puts it where one points."""
