"""Runs as ROS 2 messages, in a file and without ROS."""
