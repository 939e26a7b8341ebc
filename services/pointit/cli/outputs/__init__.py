"""Commands that test and calibrate lights."""
