"""Brake and motor control each other; the gateway passes on what they say, the cabin reads it."""

import os

from launch import LaunchDescription
from launch.actions import GroupAction, IncludeLaunchDescription, SetEnvironmentVariable
from launch_ros.actions import Node
from launch_xml.launch_description_sources import XMLLaunchDescriptionSource

HERE = os.path.dirname(os.path.abspath(__file__))


def generate_launch_description():
    chassis = IncludeLaunchDescription(
        XMLLaunchDescriptionSource(os.path.join(HERE, "vehicle_chassis.launch.xml")),
        launch_arguments={"limited": "true"}.items(),
    )
    gateway = Node(
        package="vehicle",
        executable="gateway",
        name="gateway",
        remappings=[("~/brake", "/brake_state"), ("~/motor", "/motor_state"), ("~/vehicle", "/vehicle_state")],
    )
    cabin = [("state", "vehicle_state"), ("media", "media_state")]
    nodes = [
        Node(
            package="vehicle",
            executable="infotainment",
            name="infotainment",
            ros_arguments=["--enclave", "/infotainment"],
            remappings=cabin,
        ),
        Node(
            package="vehicle",
            executable="telematics",
            name="telematics",
            ros_arguments=["--enclave", "/telematics"],
            remappings=cabin,
        ),
    ]
    secured = GroupAction([SetEnvironmentVariable("ROS_SECURITY_ENCLAVE_OVERRIDE", "/gateway"), gateway])
    return LaunchDescription([chassis, secured, *nodes])
