"""The public API: a site from Python, joined or started. Its names are those of `import pointit`."""
