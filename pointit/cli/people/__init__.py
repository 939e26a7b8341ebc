"""Commands about people: their pose, calibration and button."""
