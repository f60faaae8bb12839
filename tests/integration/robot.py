"""Four nodes, each in a process's worth of ROS of its own, until the input ends: run by ROS's Python."""

import sys

import rclpy
from rclpy.action import ActionClient, ActionServer
from rclpy.context import Context
from rclpy.node import Node
from test_msgs.action import Fibonacci
from test_msgs.msg import Strings
from test_msgs.srv import Empty


def node(name: str, enclave: str, namespace: str = "/") -> Node:
    context = Context()
    rclpy.init(args=["--ros-args", "--enclave", enclave], context=context)
    return Node(name, context=context, namespace=namespace)


talker, listener = node("talker", "/talker"), node("listener", "/listener", "/ear")
server, client = node("server", "/arm/server"), node("client", "/arm/client")
kept = [
    talker.create_publisher(Strings, "chatter", 1),
    listener.create_subscription(Strings, "/chatter", print, 1),
    server.create_service(Empty, "reset", print),
    client.create_client(Empty, "reset"),
    ActionServer(server, Fibonacci, "drive", print),
    ActionClient(client, Fibonacci, "drive"),
]
if "namesake" in sys.argv:
    kept.append(node("talker", "/other"))
print("up", flush=True)
sys.stdin.read()
