"""Selection methods: hold, fraction, gauge, estimate."""
