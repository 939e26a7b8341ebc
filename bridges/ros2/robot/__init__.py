"""Robot driver `ros2`: Nav2 by its action NavigateToPose, and drones by PoseStamped set-points."""
