"""What a viewer is sent: one file for each part of the picture."""
