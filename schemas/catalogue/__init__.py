"""The published catalogue: JSON Schema, AsyncAPI, samples and compatibility checks."""
