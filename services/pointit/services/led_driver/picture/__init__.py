"""What shines: the layout of pixels, appearance and rendering."""
