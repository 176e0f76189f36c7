"""Proximal policy optimisation in plain PyTorch: the only folder that imports torch."""
