"""The Kalman filter of the IMU's yaw drift."""
