"""A moving head whose beam follows a cursor."""
