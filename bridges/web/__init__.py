"""Web page: the scene, controls and health in a browser; its mouse or a phone as a person's wrist."""
