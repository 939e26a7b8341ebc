"""Output of frames to the LEDs: controller protocol, wiring, power and pacing."""
