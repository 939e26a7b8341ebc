"""A room that maps itself: its lights blink, a camera sees them, the solver finds where they are."""
