"""Robots and orders in the hands of somebody outside of the fleet."""
