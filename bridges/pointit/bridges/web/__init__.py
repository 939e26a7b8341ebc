"""A page in browsers: the scene, controls, health; its mouse or a phone as a person's wrist."""
