"""Objects that ROS nodes track: poses, transforms, detections and packages in the frame {W}; pure."""
