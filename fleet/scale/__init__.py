"""Scale: how far the fidelities agree, what the simulated car is fitted to, and how large a fleet a machine can run."""
