"""How frames reach the LEDs: controller protocol, wiring, power and pacing."""
