"""Selection methods: hold, fraction, gauge."""
