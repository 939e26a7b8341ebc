"""Point clouds and tables of points: PLY, texts with a point a line, columns of x, y and z."""
