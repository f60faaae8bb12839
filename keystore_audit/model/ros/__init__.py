"""What permissions mean to ROS 2 nodes: services, actions, parameters, and the topics that every node uses."""
