"""Commands about scale: whether fidelities agree, what the simulated car is fitted to, what a machine can run."""
