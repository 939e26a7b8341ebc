"""Content of the lights: layout of pixels, appearance and rendering."""
