"""The ROS graph on Zenoh: by its keys, tokens and attachments PointIt is a node, without anything of ROS."""
