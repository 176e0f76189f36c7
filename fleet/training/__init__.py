"""Training: what the trainer learns on, how it is judged, and the adapters for training libraries.

Only `fleet.training.ppo` and the adapters in `fleet.training.stacks` need more than the core's packages.
"""
