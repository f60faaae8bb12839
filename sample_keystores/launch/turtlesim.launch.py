"""What moves the turtle: the multiplexer makes it of what the keyboard and the random walker say."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

VELOCITY = "/turtle1/cmd_vel"


def generate_launch_description():
    turtlesim = Node(
        package="turtlesim",
        executable=LaunchConfiguration("simulator"),
        name="turtlesim",
        ros_arguments=["--enclave", "/turtlesim"],
        remappings=[(VELOCITY, "/move_turtle")],
    )
    multiplexer = Node(
        package="turtle_multiplexer",
        executable="multiplexer",
        name="multiplexer",
        arguments=["--ros-args", "--enclave", "/multiplexer"],
        remappings=[("high", "high_priority"), ("low", "low_priority"), ("out", "move_turtle")],
    )
    description = LaunchDescription(
        [DeclareLaunchArgument("simulator", default_value="turtlesim_node"), turtlesim, multiplexer]
    )
    description.add_action(
        Node(
            package="turtlesim",
            executable="turtle_teleop_key",
            name="keyboard",
            ros_arguments=["--enclave", "/keyboard"],
            remappings=[(VELOCITY, "/high_priority")],
        )
    )
    description.add_action(
        Node(
            package="turtle_random",
            executable="walker",
            name="random",
            ros_arguments=["--enclave", "/random"],
            remappings=[(VELOCITY, "/low_priority")],
        )
    )
    return description
