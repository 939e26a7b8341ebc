"""Cost of relays: of bytes by Zenoh, and of messages by a genuine ROS 2 node."""
