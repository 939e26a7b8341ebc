"""Maps a room from photographs of its blinking strips and lamps, or by pointing."""
