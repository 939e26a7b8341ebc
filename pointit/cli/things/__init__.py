"""Things of the map: listed, and programs that `pointit run --on` starts when people point at them."""
