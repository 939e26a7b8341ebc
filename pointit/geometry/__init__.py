"""Pure maths on numpy and scipy: rotations, rays, polylines."""
