"""ROS values as our messages and queries; pure, each function or class one route; nothing raises."""
