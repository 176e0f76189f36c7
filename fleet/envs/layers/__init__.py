"""What environments for the layers above robots have in common."""
