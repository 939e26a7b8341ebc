"""One robot that people steer."""
