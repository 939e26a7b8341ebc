"""ROS types: definitions, hashes, values and their CDR."""
