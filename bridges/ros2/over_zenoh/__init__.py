"""The ROS graph on Zenoh: a node by rmw_zenoh's keys, tokens and attachments, without an installed ROS."""
