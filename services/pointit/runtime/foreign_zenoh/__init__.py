"""Sessions of raw bytes on Zenoh networks of other systems, such as ROS 2."""
