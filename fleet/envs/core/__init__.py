"""What all environments have in common."""
