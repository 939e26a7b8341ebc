"""A wrist's IMU, real, recorded or simulated, to samples of the arm's orientation."""
