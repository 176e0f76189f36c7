"""Commands about robots by themselves."""
