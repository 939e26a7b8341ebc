"""Definitions that rosbags lacks, of packages of others: services, actions, and messages beside ROS's core.

They are not in `interfaces/`, where colcon would build second packages of these names.
"""

from pointit.bridges.ros2.graph.backend import Distro

NAVIGATE_TO_POSE = "nav2_msgs/action/NavigateToPose"

STANDARD_SERVICES = {
    "action_msgs/srv/CancelGoal": "action_msgs/GoalInfo goal_info\n---\nint8 ERROR_NONE=0\n"
    "int8 ERROR_REJECTED=1\nint8 ERROR_UNKNOWN_GOAL_ID=2\nint8 ERROR_GOAL_TERMINATED=3\n"
    "int8 return_code\naction_msgs/GoalInfo[] goals_canceling\n",
    "rcl_interfaces/srv/GetParameters": "string[] names\n---\nrcl_interfaces/ParameterValue[] values\n",
    "rcl_interfaces/srv/ListParameters": "uint64 DEPTH_RECURSIVE=0\nstring[] prefixes\nuint64 depth\n---\n"
    "rcl_interfaces/ListParametersResult result\n",
    "std_srvs/srv/Empty": "---\n",
    "std_srvs/srv/SetBool": "bool data\n---\nbool success\nstring message\n",
    "std_srvs/srv/Trigger": "---\nbool success\nstring message\n",
}

# Fields of hri_msgs 2.3.2 (ROS4HRI, Apache License 2.0).
ROS4HRI_MESSAGES = {
    "hri_msgs/msg/IdsList": "std_msgs/Header header\nstring[] ids\n",
    "hri_msgs/msg/IdsMatch": "int8 UNSET=0\nint8 PERSON=1\nint8 FACE=2\nint8 BODY=3\nint8 VOICE=4\n"
    "string id1\nint8 id1_type\nstring id2\nint8 id2_type\nfloat32 confidence\n",
}

# Fields of vision_msgs 4 (Apache License 2.0), that of Humble and newer.
VISION_MESSAGES = {
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/msg/ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\n"
    "geometry_msgs/PoseWithCovariance pose\n",
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "vision_msgs/msg/Detection3D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
    "vision_msgs/BoundingBox3D bbox\nstring id\n",
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n",
}

# Fields of nav2_msgs (Apache License 2.0), which differ between distributions.
_GOAL = "geometry_msgs/PoseStamped pose\nstring behavior_tree\n"
_CODE = "uint16 NONE=0\nuint16 error_code\n"
_FEEDBACK = (
    "geometry_msgs/PoseStamped current_pose\nbuiltin_interfaces/Duration navigation_time\n"
    "builtin_interfaces/Duration estimated_time_remaining\nint16 number_of_recoveries\n"
    "float32 distance_remaining\n"
)
_TRACKING = "float32 position_tracking_error\nfloat32 heading_tracking_error\n"
_RESULTS = {"humble": "std_msgs/Empty result\n", "jazzy": _CODE}


def actions(distro: Distro) -> dict[str, str]:
    """Return name and text of the actions that nodes of `distro` have: goal, result and feedback."""
    result = _RESULTS.get(distro, f"{_CODE}string error_msg\n")
    feedback = _FEEDBACK + (_TRACKING if distro in {"lyrical", "rolling"} else "")
    return {NAVIGATE_TO_POSE: f"{_GOAL}---\n{result}---\n{feedback}"}
