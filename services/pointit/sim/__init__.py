"""The world without a bus: recordings read back."""
